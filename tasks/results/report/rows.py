"""Groups of episodes as lines of a table, with their intervals drawn."""

import math
from collections.abc import Callable, Mapping, Sequence

from specs.base import Spec
from tasks.results.report.scales import Bar, Scale, scale
from tasks.results.statistics import Interval
from tasks.results.summary import Group

# A page with more lines is read by nobody; the Parquet files have them all.
MOST_ROWS = 40
_LONGEST = 60


class Row(Spec):
    """One group: its name, its numbers as text, and where its interval stands."""

    label: str
    counts: str
    rate: str
    interval: str
    bar: Bar
    why: str


class RateTable(Spec):
    """Groups under a heading.

    Attributes:
        caption: What the rows are.
        head: What their names are.
        left_out: How many rows more there were.
    """

    caption: str
    head: str
    scale: Scale
    rows: tuple[Row, ...]
    left_out: int


def rate_table(
    caption: str,
    head: str,
    groups: Sequence[Group],
    *,
    goal: float | None,
    why: Mapping[str, str] | None = None,
    label: Callable[[str], str] = str,
) -> RateTable:
    """Returns a table of groups, as many as are read.

    Args:
        caption: What the rows are.
        head: What their names are.
        groups: In the order in which they are shown.
        goal: The gate's bar, or None.
        why: Why episodes did not pass, by the group's label.
        label: Makes what is shown of a label.
    """
    shown = groups[:MOST_ROWS]
    axis = scale(shown, goal)
    return RateTable(
        caption=caption,
        head=head,
        scale=axis,
        rows=tuple(rate_row(group, axis, label(group.label), (why or {}).get(group.label, "")) for group in shown),
        left_out=len(groups) - len(shown),
    )


def rate_row(group: Group, axis: Scale, label: str, why: str = "") -> Row:
    """Returns a group as a line."""
    canceled = f", {group.canceled} canceled" if group.canceled else ""
    return Row(
        label=clipped(label, _LONGEST),
        counts=f"{group.successes:,} of {group.episodes:,}{canceled}",
        rate="-" if group.rate is None else percent(group.rate),
        interval=percent_range(group.interval),
        bar=axis.bar(group.interval, group.rate),
        why=why,
    )


def worst_first(groups: Sequence[Group]) -> list[Group]:
    """Returns groups by their share of successes, the least first; those without episodes at the end."""
    return sorted(groups, key=lambda group: (2.0 if group.rate is None else group.rate, group.label))


def percent(share: float) -> str:
    """Returns a share as text; what is not quite everything or nothing is never rounded to it."""
    shown = round(100.0 * share, 1)
    if shown in (0.0, 100.0) and share not in (0.0, 1.0):
        return ">\u00a099.9\u00a0%" if shown else "<\u00a00.1\u00a0%"
    return f"{shown:.1f}\u00a0%"


def percent_range(interval: Interval) -> str:
    """Returns an interval as text, rounded outwards, so that no bound is printed on the wrong side of a bar."""
    return f"{math.floor(1000 * interval.lower) / 10:.1f} to {math.ceil(1000 * interval.upper) / 10:.1f}\u00a0%"


def reasons_text(reasons: Sequence[tuple[str, int]]) -> str:
    """Returns reasons with their counts, as a list in words."""
    return ", ".join(f"{count:,} {name}" for name, count in reasons)


def short_world(worlds: Sequence[str]) -> Callable[[str], str]:
    """Returns what shortens a world's name: without its generation, where all worlds have the same."""
    generations = {world.partition("/")[0] for world in worlds}
    return (lambda world: world.partition("/")[2] or world) if len(generations) == 1 else str


def clipped(text: str, most: int) -> str:
    """Returns the text in one line, cut off with an ellipsis where it is longer."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"
