"""What a trend shows, and its page: one HTML file that loads and runs nothing, in the report's colours."""

from collections.abc import Sequence

import numpy as np

from specs.base import Spec
from tasks.results.report.report_page import page_templates, report_styles
from tasks.results.statistics.change_point import Change
from tasks.results.statistics.intervals import wilson_bounds
from tasks.results.trend.trend_chart import Chart, draw_chart, fitting_axis, relative
from tasks.results.trend.trend_series import CONFIDENCE, Night, Point, Series, Trend, day, night_times

# More lines nobody reads on a page; `simyard trend --json` has all nights.
MOST_ROWS = 100


class Alarm(Spec):
    """A change that was seen, for people, programs and Prefect's events.

    Attributes:
        series: What it was seen in: all episodes, a world, or a variable's value.
        fell: Whether the rate fell.
        sentence: What happened, in words.
        before: Rate before the change; ``after`` since.
        began: Batch that it most likely began with; ``began_on`` its day.
        bundle: SHA-256 of each robot application that was tested that night; ``bundle_name`` with its version.
        new_bundle: Whether that night was the first of another bundle.
        earliest: The first batch of those that it may have begun with; ``latest`` the last.
        seen: Batch at whose end it was seen; ``seen_on`` its day, ``run`` the document's run.
    """

    series: str
    fell: bool
    sentence: str
    before: float
    after: float
    began: str
    began_on: str
    bundle: str
    bundle_name: str
    new_bundle: bool
    earliest: str
    latest: str
    seen: str
    seen_on: str
    run: str


class NightRow(Spec):
    """A night in the table; its rate and the bounds are of its own worlds, of which ``worlds`` says how many."""

    day: str
    batch: str
    bundle: str
    passed: int | None
    episodes: int | None
    worlds: int
    rate: float | None
    lower: float | None
    upper: float | None
    note: str
    href: str


class BundleRow(Spec):
    """All nights of one bundle together, in their own worlds; nights that drove the same again are counted once."""

    name: str
    first: str
    last: str
    nights: int
    passed: int
    episodes: int
    worlds: int
    rate: float
    lower: float
    upper: float


class TrendView(Spec):
    """What is shown.

    Attributes:
        document: The document's name.
        words: What the rates are shares of.
        chosen: Which episodes are looked at; empty for all.
        alarms: The newest first.
        standing: Whether the last change of all episodes was a fall.
        whole: The chart of all episodes; None without a night.
        multiples: The other series, by kind.
        rows: Nights, the newest first.
        more_rows: How many nights are not in the table.
        notice: What is to be known of who vouches for the nights; empty if this machine's key does.
        limit: How many nights pass until a false alarm, at least.
    """

    document: str
    words: str
    chosen: str
    nights: int
    alarms: tuple[Alarm, ...]
    standing: bool
    whole: Chart | None
    multiples: tuple[tuple[str, tuple[Chart, ...]], ...]
    left_out: int
    bundles: tuple[BundleRow, ...]
    rows: tuple[NightRow, ...]
    more_rows: int
    notice: str
    limit: float


def trend_view(
    trend: Trend, *, document: str, words: str, chosen: str, first: int, base: str, limit: float
) -> TrendView:
    """Returns what is shown of a trend.

    Args:
        trend: All nights.
        document: The document's name.
        words: What the rates are shares of.
        chosen: Which episodes are looked at; empty for all.
        first: The first night that is shown; changes are looked for in all of them.
        base: URL of the folder that the page's relative links start from; empty if all links are whole.
        limit: How many nights pass until a false alarm, at least.
    """
    whole, nights = trend.series[0], trend.nights
    alarms = [alarm_of(trend, each, change) for each, change in trend.alarms() if change.seen >= first]
    drawable = any(point for point in whole.points[first:])
    times = night_times(nights)
    rows = [
        _row(night, point, base, times[night.begun_at_s]) for night, point in zip(nights, whole.points, strict=True)
    ][first:]
    return TrendView(
        document=document,
        words=words,
        chosen=chosen,
        nights=len(rows),
        alarms=tuple(alarms),
        standing=bool(whole.changes) and whole.changes[-1].fell,
        whole=_chart(trend, whole, [whole], first, base) if drawable else None,
        multiples=_multiples(trend, first, base),
        left_out=trend.left_out,
        bundles=_bundle_rows(trend, first),
        rows=tuple(reversed(rows[-MOST_ROWS:])),
        more_rows=max(0, len(rows) - MOST_ROWS),
        notice=_notice(nights[first:]),
        limit=limit,
    )


def alarm_of(trend: Trend, series: Series, change: Change) -> Alarm:
    """Returns a change with its nights named."""
    began, seen, earliest, latest = (
        trend.nights[at] for at in (change.began, change.seen, change.earliest, change.latest)
    )
    times = night_times(trend.nights)
    before = next(
        (night.bundles() for night in reversed(trend.nights[: change.began]) if not night.left_out), frozenset()
    )
    new = bool(before) and before != began.bundles()
    name = series.label if series.kind in {"all", "world"} else f"{series.kind} = {series.label}"
    verb = "fell" if change.fell else "rose"
    sentence = (
        f"{name}: the rate {verb} from {100 * change.before:.1f} to {100 * change.after:.1f} %. "
        f"It most likely began on {times[began.begun_at_s]} with {began.bundle_names()}, "
        f"{'the first night of that bundle' if new else 'which was no new bundle'}"
    )
    if earliest.batch != latest.batch:
        sentence += f"; it may have begun from {times[earliest.begun_at_s]} to {times[latest.begun_at_s]}"
    return Alarm(
        series=name,
        fell=change.fell,
        sentence=f"{sentence}. It was seen on {times[seen.begun_at_s]}.",
        before=change.before,
        after=change.after,
        began=began.arn,
        began_on=day(began.begun_at_s),
        bundle=", ".join(each.digest for each in began.robots),
        bundle_name=began.bundle_names(),
        new_bundle=new,
        earliest=earliest.arn,
        latest=latest.arn,
        seen=seen.arn,
        seen_on=day(seen.begun_at_s),
        run=seen.run,
    )


def _chart(trend: Trend, series: Series, beside: Sequence[Series], first: int, base: str) -> Chart:
    sentences = [alarm_of(trend, series, change).sentence for change in series.changes]
    axis = fitting_axis(beside, first)
    return draw_chart(series, trend.nights, axis, first=first, base=base, sentences=sentences)


def _multiples(trend: Trend, first: int, base: str) -> tuple[tuple[str, tuple[Chart, ...]], ...]:
    """Returns the other series by kind, on one axis each, those with alarms first and then the worst."""
    found: list[tuple[str, tuple[Chart, ...]]] = []
    drawn = [each for each in trend.series[1:] if any(each.points[first:])]
    for kind in dict.fromkeys(each.kind for each in drawn):
        some = [each for each in drawn if each.kind == kind]
        some.sort(key=lambda each: (not each.changes, _mean(each, first) if kind == "world" else 0.0))
        title = "By world" if kind == "world" else f"By {kind}"
        found.append((title, tuple(_chart(trend, each, some, first, base) for each in some)))
    return tuple(found)


def _mean(series: Series, first: int) -> float:
    counts = [point.count for point in series.points[first:] if point]
    return sum(count.successes for count in counts) / max(1, sum(count.n for count in counts))


def _row(night: Night, point: Point | None, base: str, when: str) -> NightRow:
    notes = [night.left_out] if night.left_out else []
    notes += ["no episode"] if point is None and not night.left_out else []
    notes += ["the same as before"] if point and point.repeats else []
    notes += ["ended early"] if point and night.early else []
    notes += ["not vouched for"] if point and not night.authentic else []
    return NightRow(
        day=when,
        batch=night.batch or night.run,
        bundle=night.bundle_names(),
        passed=point.count.successes if point else None,
        episodes=point.count.n if point else None,
        worlds=len(point.worlds) if point else 0,
        rate=point.rate if point else None,
        lower=point.lower if point else None,
        upper=point.upper if point else None,
        note=", ".join(notes),
        href=relative(night.page, base),
    )


def _bundle_rows(trend: Trend, first: int) -> tuple[BundleRow, ...]:
    """Returns the bundles that were tested, the newest first."""
    groups: dict[frozenset[str], list[tuple[Night, Point]]] = {}
    for night, point in list(zip(trend.nights, trend.series[0].points, strict=True))[first:]:
        if point:
            groups.setdefault(night.bundles(), []).append((night, point))
    return tuple(reversed([_bundle_row(found) for found in groups.values()]))[:MOST_ROWS]


def _bundle_row(found: Sequence[tuple[Night, Point]]) -> BundleRow:
    fresh = [point for _, point in found if not point.repeats] or [found[0][1]]
    passed, n = (sum(point.count[at] for point in fresh) for at in (0, 1))
    lower, upper = wilson_bounds(np.array(float(passed)), np.array(float(n)), CONFIDENCE)
    return BundleRow(
        name=found[0][0].bundle_names(),
        first=day(found[0][0].begun_at_s),
        last=day(found[-1][0].begun_at_s),
        nights=len(found),
        passed=int(passed),
        episodes=int(n),
        worlds=len(frozenset[str]().union(*(point.worlds for point in fresh))),
        rate=passed / n,
        lower=float(lower),
        upper=float(upper),
    )


def _notice(nights: Sequence[Night]) -> str:
    count = sum(1 for night in nights if night.cells and not night.authentic)
    if not count:
        return ""
    were = "night is" if count == 1 else "nights are"
    return (
        f"{count} {were} not vouched for by this machine's key: another machine or an older version wrote the results, "
        "or somebody changed them"
    )


_PACKAGE = "tasks.results.trend"


def trend_page(view: TrendView) -> bytes:
    """Returns the page, the same bytes for the same view."""
    styles = f"{report_styles()}\n{page_templates(_PACKAGE).get_template('trend.css').render().rstrip()}"
    return page_templates(_PACKAGE).get_template("trend.html.j2").render(view=view, styles=styles).encode()
