"""The report's tables of success rates: a line a group of episodes, with its interval drawn on an axis.

Positions on an axis are percentages of a drawing's width.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from specs.base import Spec
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.summary import EpisodeGroup

# So that what stands at either end is whole.
_MARGIN_PERCENT = 4.0
_TICKS: dict[float, tuple[float, ...]] = {
    0.9: (0.9, 0.95, 1.0),
    0.8: (0.8, 0.9, 1.0),
    0.5: (0.5, 0.75, 1.0),
    0.0: (0.0, 0.5, 1.0),
}


class Tick(Spec):
    """A mark on an axis: where, and what it says."""

    at: str
    text: str


class Bar(Spec):
    """An interval and the share in it, on an axis.

    Attributes:
        begin: Of the interval; ``length`` its length.
        dot: The share, or empty without episodes.
    """

    begin: str
    length: str
    dot: str


class Scale(Spec):
    """An axis of shares from ``low`` to 1.

    Attributes:
        low: Share at the left end, 0 to below 1.
        ticks: Its marks.
        goal: Where the gate's bar stands, or empty.
        goal_left: Whether that is in the left half, so that what is written there has room to its right.
    """

    low: float
    ticks: tuple[Tick, ...]
    goal: str
    goal_left: bool

    def bar(self, interval: Interval, rate: float | None) -> Bar:
        """Returns an interval and a share on this axis."""
        begin, end = _place(interval.lower, self.low), _place(interval.upper, self.low)
        dot = "" if rate is None else _percent(_place(rate, self.low))
        return Bar(begin=_percent(begin), length=_percent(end - begin), dot=dot)


def scale(groups: Sequence[EpisodeGroup], goal: float | None) -> Scale:
    """Returns the axis that shows all groups and the gate's bar, and as little else as round marks allow."""
    shares = [group.interval.lower for group in groups if group.episodes] + ([] if goal is None else [goal])
    lowest = min(shares, default=0.0)
    low = next(begin for begin in _TICKS if begin <= lowest)
    ticks = tuple(Tick(at=_percent(_place(share, low)), text=f"{100 * share:g}\u00a0%") for share in _TICKS[low])
    place = None if goal is None else _place(goal, low)
    return Scale(
        low=low, ticks=ticks, goal="" if place is None else _percent(place), goal_left=place is None or place < 50.0
    )


def _place(share: float, low: float) -> float:
    return _MARGIN_PERCENT + (100.0 - 2 * _MARGIN_PERCENT) * max(0.0, share - low) / (1.0 - low)


def _percent(value: float) -> str:
    return f"{value:.2f}%"


# A page with more lines is read by nobody; the Parquet files have them all.
MOST_ROWS = 40
_LONGEST = 60


class RateRow(Spec):
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
    rows: tuple[RateRow, ...]
    left_out: int


def rate_table(
    caption: str,
    head: str,
    groups: Sequence[EpisodeGroup],
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


def rate_row(group: EpisodeGroup, axis: Scale, label: str, why: str = "") -> RateRow:
    """Returns a group as a line.

    Args:
        group: The group.
        axis: Where its interval is drawn.
        label: Its name on the page.
        why: Why its episodes did not pass, or empty.
    """
    canceled = f", {group.canceled} canceled" if group.canceled else ""
    return RateRow(
        label=clip(label, _LONGEST),
        counts=f"{group.successes:,} of {group.episodes:,}{canceled}",
        rate="-" if group.rate is None else percent(group.rate),
        interval=percent_range(group.interval),
        bar=axis.bar(group.interval, group.rate),
        why=why,
    )


def worst_first(groups: Sequence[EpisodeGroup]) -> list[EpisodeGroup]:
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


def clip(text: str, most: int) -> str:
    """Returns the text in one line, cut off with an ellipsis where it is longer."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"
