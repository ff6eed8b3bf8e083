"""Where shares and their intervals stand on an axis, as percentages of a drawing's width."""

from collections.abc import Sequence

from specs.base import Spec
from tasks.results.statistics import Interval
from tasks.results.summary import Group

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


def scale(groups: Sequence[Group], goal: float | None) -> Scale:
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
