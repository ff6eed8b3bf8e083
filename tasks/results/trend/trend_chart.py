"""A series as a chart: a dot a night, the band of its intervals, and where the rate changed.

Positions are percentages of a drawing's width and height, so that the text keeps its size on any screen; outlines are
drawn in a square of 1000 by 1000 that is stretched.
"""

import itertools
import math
from collections.abc import Sequence

from specs.base import Spec
from tasks.results.statistics.change_point import Change
from tasks.results.trend.trend_series import Night, Point, Series, day, night_text

_STEPS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25)
_MOST_TICKS = 5
_MARGIN = 2.0
# Names of bundles that are closer would lie over one another.
_APART = 9.0
_LONGEST_NAME = 14


class Tick(Spec):
    """A rate on the axis: where, and what it says."""

    at: str
    text: str


class Dot(Spec):
    """One night: its place, its hit area, its kind (``night``, ``repeat`` or ``out``), and what is said of it."""

    x: str
    y: str
    begin: str
    width: str
    kind: str
    text: str
    href: str


class BundleMark(Spec):
    """The first night of another bundle; the name is empty where there is no room."""

    x: str
    name: str
    title: str


class DayMark(Spec):
    """A day below the chart: where, and whether its text begins, has its middle or ends there."""

    x: str
    text: str
    anchor: str


class ChangeMark(Spec):
    """A change: where the new level begins, the nights that may be the beginning, and the night of the alarm."""

    x: str
    begin: str
    width: str
    seen: str
    fell: bool
    text: str
    anchor: str


class Level(Spec):
    """The rate between two changes."""

    begin: str
    end: str
    y: str


class Chart(Spec):
    """A drawn series.

    Attributes:
        band: Outline of the intervals.
        line: The rates.
        words: What the chart shows, for who does not see it.
    """

    name: str
    words: str
    ticks: tuple[Tick, ...]
    band: str
    line: str
    dots: tuple[Dot, ...]
    days: tuple[DayMark, ...]
    bundles: tuple[BundleMark, ...]
    changes: tuple[ChangeMark, ...]
    levels: tuple[Level, ...]


class Axis(Spec):
    """Rates from ``low`` to ``high``."""

    low: float
    high: float
    step: float

    def at(self, rate: float) -> float:
        """Returns where a rate stands, in percent from above."""
        return 6.0 + 88.0 * (self.high - rate) / (self.high - self.low)

    def ticks(self) -> tuple[Tick, ...]:
        """Returns the marks of the axis."""
        count = round((self.high - self.low) / self.step)
        rates = [self.low + number * self.step for number in range(count + 1)]
        return tuple(Tick(at=percent_of(self.at(rate)), text=f"{100 * rate:g} %") for rate in rates)


def fitting_axis(series: Sequence[Series], first: int) -> Axis:
    """Returns an axis that all rates and intervals of some series fit on, from a night on."""
    points = [point for each in series for point in each.points[first:] if point]
    low, high = min(point.lower for point in points), max(point.upper for point in points)
    step = next((step for step in _STEPS if (high - low) / step <= _MOST_TICKS - 1), _STEPS[-1])
    bottom = round(math.floor(low / step + 1e-9) * step, 6)
    return Axis(low=bottom, high=min(1.0, round(math.ceil(high / step - 1e-9) * step, 6)), step=step)


def draw_chart(
    series: Series, nights: Sequence[Night], axis: Axis, *, first: int, base: str, sentences: Sequence[str]
) -> Chart:
    """Returns the chart of a series.

    Args:
        series: What is drawn.
        nights: All nights of the trend.
        axis: For its rates.
        first: The first night that is drawn.
        base: URL of the folder that the page's relative links start from; empty if all links are whole.
        sentences: What is said of each of the series' changes.
    """
    places = _Places(first=first, count=len(nights) - first)
    shown = [(at, point) for at, point in enumerate(series.points) if point and at >= first]
    upper = [f"{places.point(at)},{10 * axis.at(point.upper):.1f}" for at, point in shown]
    lower = [f"{places.point(at)},{10 * axis.at(point.lower):.1f}" for at, point in reversed(shown)]
    rates = [f"{places.point(at)},{10 * axis.at(point.rate):.1f}" for at, point in shown]
    drawn = [pair for pair in zip(series.changes, sentences, strict=True) if pair[0].seen >= first]
    return Chart(
        name=series.label if series.kind in {"all", "world"} else f"{series.kind} = {series.label}",
        words=_words(shown, nights),
        ticks=axis.ticks(),
        band=f"M{'L'.join([*upper, *lower])}Z",
        line=f"M{'L'.join(rates)}",
        dots=tuple(
            _dot(series.points[at], night, at, places, axis=axis, base=base)
            for at, night in enumerate(nights)
            if at >= first
        ),
        days=_days(nights, places),
        bundles=_bundles(nights, places),
        changes=tuple(_change(change, text, places) for change, text in drawn),
        levels=_levels(series, places, axis),
    )


def percent_of(value: float) -> str:
    """Returns a position in a drawing, such as ``12.5%``."""
    return f"{value:.2f}%".replace(".00%", "%")


class _Places(Spec):
    """Where nights stand: the first and how many."""

    first: int
    count: int

    def at(self, night: float) -> float:
        """Returns where a night stands, in percent from the left."""
        return _MARGIN + (100.0 - 2 * _MARGIN) * (night - self.first + 0.5) / self.count

    def point(self, night: int) -> str:
        """Returns where a night stands in a square of 1000."""
        return f"{10 * self.at(night):.1f}"

    def text(self, night: float) -> str:
        """Returns where a night stands, but for what is drawn further left."""
        return percent_of(max(_MARGIN, self.at(night)))


def _dot(point: Point | None, night: Night, at: int, places: _Places, *, axis: Axis, base: str) -> Dot:
    kind = "out" if point is None else "repeat" if point.repeats else "night"
    width = (100.0 - 2 * _MARGIN) / places.count
    return Dot(
        x=places.text(at),
        y=percent_of(axis.at(point.rate) if point else 97.0),
        begin=percent_of(places.at(at) - width / 2),
        width=percent_of(width),
        kind=kind,
        text=night_text(night, point),
        href=relative(night.page, base),
    )


def relative(url: str, base: str) -> str:
    """Returns a link from a page in the folder ``base``/trends to what lies below ``base``; others stay whole."""
    if base and url.startswith(f"{base}/"):
        return f"../{url.removeprefix(f'{base}/')}"
    return url


def _days(nights: Sequence[Night], places: _Places) -> tuple[DayMark, ...]:
    """Returns the first day that is drawn, the one in the middle, and the last."""
    last = len(nights) - 1
    marked = {places.first: "start", last: "end"}
    if places.count > _MOST_TICKS:
        marked[(places.first + last) // 2] = "middle"
    return tuple(
        DayMark(x=places.text(at), text=day(nights[at].begun_at_s), anchor=anchor)
        for at, anchor in sorted(marked.items())
    )


def _bundles(nights: Sequence[Night], places: _Places) -> tuple[BundleMark, ...]:
    found: list[BundleMark] = []
    before: frozenset[str] | None = None
    free = -math.inf
    for at, night in enumerate(nights):
        if night.left_out:
            continue
        now = night.bundles()
        if now != before and at >= places.first and before is not None:
            x = places.at(at)
            room = x >= free and x < 100.0 - _APART
            name = ", ".join(each.version for each in night.robots)[:_LONGEST_NAME] if room else ""
            free = x + _APART if room else free
            title = f"{day(night.begun_at_s)}: first night of {night.bundle_names()}"
            found.append(BundleMark(x=percent_of(x), name=name, title=title))
        before = now
    return tuple(found)


def _change(change: Change, text: str, places: _Places) -> ChangeMark:
    begin, end = places.at(max(change.earliest, places.first) - 0.5), places.at(change.latest + 0.5)
    return ChangeMark(
        x=places.text(change.began - 0.5),
        begin=percent_of(begin),
        width=percent_of(end - begin),
        seen=places.text(change.seen),
        fell=change.fell,
        text=text,
        anchor="end" if places.at(change.began) > 60.0 else "start",
    )


def _levels(series: Series, places: _Places, axis: Axis) -> tuple[Level, ...]:
    """Returns the rate from each change to the next one."""
    begins = [0, *(change.began for change in series.changes), len(series.points)]
    found: list[Level] = []
    for begin, end in itertools.pairwise(begins):
        counts = [point.count for point in series.points[begin:end] if point and not point.repeats]
        n = sum(count.n for count in counts)
        if n and end > places.first:
            rate = sum(count.successes for count in counts) / n
            y = percent_of(axis.at(min(axis.high, max(axis.low, rate))))
            found.append(Level(begin=places.text(begin - 0.5), end=places.text(end - 0.5), y=y))
    return tuple(found)


def _words(shown: Sequence[tuple[int, Point]], nights: Sequence[Night]) -> str:
    if not shown:
        return "No night."
    (first, _), (last, point) = shown[0], shown[-1]
    rates = [each.rate for _, each in shown]
    return (
        f"{len(shown)} nights from {day(nights[first].begun_at_s)} to {day(nights[last].begun_at_s)}; rates between "
        f"{100 * min(rates):.1f} and {100 * max(rates):.1f} %, the last one {100 * point.rate:.1f} %."
    )
