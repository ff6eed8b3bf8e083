"""The report's tables of success rates: a line a group of episodes, with its intervals drawn on an axis.

Positions on an axis are percentages of a drawing's width.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from specs.base import Spec
from tasks.results.report.batch_facts import BatchFacts
from tasks.results.statistics.batch_summary import EpisodeGroup
from tasks.results.statistics.intervals import Interval, IntervalFamily, in_worlds, percent, percent_range

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


def scale(lowers: Sequence[float], goal: float | None) -> Scale:
    """Returns the axis that shows intervals and the gate's bar, and as little else as round marks allow.

    Args:
        lowers: Lower bounds of the intervals.
        goal: The gate's bar, or None.
    """
    shares = [*lowers, *(() if goal is None else (goal,))]
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
# Fewer lines are read sooner than they are unfolded.
_FOLDED_FROM = 4


class RateRow(Spec):
    """One group: its name, its numbers as text, and where its intervals stand.

    Attributes:
        interval: The one that holds together with those of all other groups; of all episodes, their own.
        bar: It, drawn.
        alone: The one that holds by itself: Wilson's, unless the batch might have ended early.
        bar_alone: It, drawn.
        passed: Whether all of its episodes did.
    """

    label: str
    counts: str
    rate: str
    interval: str
    bar: Bar
    alone: str
    bar_alone: Bar
    why: str
    passed: bool = False


class RateTable(Spec):
    """Groups under a heading.

    Attributes:
        caption: What the rows are.
        where: In which worlds their rates hold.
        head: What their names are.
        left_out: How many rows more there were.
        folds: Whether rows whose episodes all passed are shown when they are asked for.
    """

    caption: str
    where: str
    head: str
    scale: Scale
    rows: tuple[RateRow, ...]
    left_out: int
    folds: bool = False


class Grouped(NamedTuple):
    """Groups that a table is made of.

    Attributes:
        caption: What the rows are.
        where: In which worlds their rates hold.
        head: What their names are.
        groups: In the order in which they are shown.
        why: Why episodes did not pass, by the group's label.
        label: Makes what is shown of a label.
        folds: Whether groups whose episodes all passed are folded, if they are many and others did not.
    """

    caption: str
    where: str
    head: str
    groups: Sequence[EpisodeGroup]
    why: Mapping[str, str] = MappingProxyType({})
    label: Callable[[str], str] = str
    folds: bool = False


def family_of(tables: Sequence[Grouped], confidence: float, looks: int = 0) -> IntervalFamily:
    """Returns the family of the intervals of all groups that have episodes, also of those that no table has room for.

    Args:
        tables: All that a page shows.
        confidence: How often all of them hold, between 0 and 1.
        looks: At how many looks the batch might have been ended; 0 of one that was driven to its end.
    """
    size = sum(bool(group.episodes) for table in tables for group in table.groups)
    return IntervalFamily(size=size, confidence=confidence, looks=looks)


def rate_table(found: Grouped, family: IntervalFamily, goal: float | None) -> RateTable:
    """Returns a table of groups, as many as are read.

    Args:
        found: The groups.
        family: Of all groups of the page.
        goal: The gate's bar, or None.
    """
    shown = found.groups[:MOST_ROWS]
    axis = scale([family.interval(group.successes, group.episodes).lower for group in shown if group.episodes], goal)
    return RateTable(
        caption=found.caption,
        where=found.where,
        head=found.head,
        scale=axis,
        rows=tuple(
            rate_row(group, axis, found.label(group.label), family, found.why.get(group.label, "")) for group in shown
        ),
        left_out=len(found.groups) - len(shown),
        folds=found.folds and _FOLDED_FROM <= sum(map(_has_passed, shown)) < len(shown),
    )


def rate_row(group: EpisodeGroup, axis: Scale, label: str, family: IntervalFamily | None, why: str = "") -> RateRow:
    """Returns a group as a line.

    Args:
        group: The group.
        axis: Where its interval is drawn.
        label: Its name on the page.
        family: Of all groups of the page; None for all episodes, whose interval is of no family.
        why: Why its episodes did not pass, or empty.
    """
    canceled = f", {group.canceled} canceled" if group.canceled else ""
    interval = family.interval(group.successes, group.episodes) if family else group.interval
    return RateRow(
        label=clip(label, _LONGEST),
        counts=f"{group.successes:,} of {group.episodes:,}{canceled}",
        rate="-" if group.rate is None else percent(group.rate),
        interval=percent_range(interval),
        bar=axis.bar(interval, group.rate),
        alone=percent_range(group.interval),
        bar_alone=axis.bar(group.interval, group.rate),
        why=why,
        passed=_has_passed(group),
    )


def _has_passed(group: EpisodeGroup) -> bool:
    return bool(group.episodes) and group.successes == group.episodes


class JudgedRate(Spec):
    """The rate beside the verdict, in words and on an axis."""

    text: str
    axis: Scale
    bar: Bar


def judged_rate(total: EpisodeGroup, facts: BatchFacts, confidence: float, worlds: int) -> JudgedRate:
    """Returns the rate that was judged, or that of all episodes, with the worlds in which it holds.

    Args:
        total: All episodes.
        facts: The batch, with the gate's answer.
        confidence: Coverage of the interval.
        worlds: How many worlds the episodes that were judged were in.
    """
    judgement, method = facts.judgement, "exact, at any look" if facts.looks else "Wilson"
    rate, interval = total.rate, total.interval
    if judgement and judgement.interval:
        rate, interval, method = judgement.rate, judgement.interval, judgement.method
    axis = scale([interval.lower] if total.episodes else [], judgement.at_least if judgement else None)
    where = in_worlds(worlds, like_these=bool(judgement and judgement.interval and judgement.over_worlds))
    text = f"{100 * confidence:g}\u00a0% interval ({method}) {percent_range(interval)} {where}"
    shown = "no rate" if rate is None else percent(rate)
    return JudgedRate(text=f"{shown}, {text}", axis=axis, bar=axis.bar(interval, rate))


def worst_first(groups: Sequence[EpisodeGroup]) -> list[EpisodeGroup]:
    """Returns groups by their share of successes, the least first; those without episodes at the end."""
    return sorted(groups, key=lambda group: (2.0 if group.rate is None else group.rate, by_number(group.label)))


def by_number(name: str) -> tuple[tuple[str, int], ...]:
    """Returns what sorts names as people count: world-2 before world-10."""
    return tuple((text, int(digits or 0)) for text, digits in re.findall(r"(\D*)([0-9]{0,18})", name))


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
