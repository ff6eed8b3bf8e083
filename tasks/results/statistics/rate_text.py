"""Rates in words: a share, its interval, and what it is a rate of.

A rate that was measured in eight worlds is the rate in these eight, with other seeds. What it is in worlds like them is
another question, with a wider interval. Wherever an interval stands, one of these phrases stands beside it.
"""

import math

from tasks.results.statistics.intervals import Interval


def in_worlds(worlds: int, *, like_these: bool = False) -> str:
    """Returns where a rate holds, such as ``in these 8 worlds``.

    Args:
        worlds: How many worlds its episodes were in.
        like_these: Whether its interval is of worlds like these, and not of these alone.
    """
    if worlds < 1:
        return "in no world"
    if like_these:
        return f"in worlds like {'this 1' if worlds == 1 else f'these {worlds:,}'}"
    return "in this 1 world" if worlds == 1 else f"in these {worlds:,} worlds"


def percent(share: float) -> str:
    """Returns a share as text; what is not quite everything or nothing is never rounded to it."""
    shown = round(100.0 * share, 1)
    if shown in (0.0, 100.0) and share not in (0.0, 1.0):
        return ">\u00a099.9\u00a0%" if shown else "<\u00a00.1\u00a0%"
    return f"{shown:.1f}\u00a0%"


def percent_range(interval: Interval) -> str:
    """Returns an interval as text, rounded outwards, so that no bound is printed on the wrong side of a bar."""
    return f"{math.floor(1000 * interval.lower) / 10:.1f} to {math.ceil(1000 * interval.upper) / 10:.1f}\u00a0%"
