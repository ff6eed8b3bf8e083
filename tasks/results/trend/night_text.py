"""What a night is called, and what is said of it in one line."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime

from tasks.results.statistics.rate_text import in_worlds
from tasks.results.trend.night import Night
from tasks.results.trend.series import Point


def day(seconds: float) -> str:
    """Returns the day of a time, in UTC."""
    return datetime.fromtimestamp(seconds, tz=UTC).strftime("%Y-%m-%d")


def night_times(nights: Sequence[Night]) -> dict[float, str]:
    """Returns what each night is called, by its begin: its day, with hour and minute if that day has several."""
    days = [day(night.begun_at_s) for night in nights]
    several = {each for each, count in Counter(days).items() if count > 1}
    return {
        night.begun_at_s: f"{each} {_clock(night.begun_at_s)}" if each in several else each
        for night, each in zip(nights, days, strict=True)
    }


def _clock(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, tz=UTC).strftime("%H:%M")


def night_text(night: Night, point: Point | None) -> str:
    """Returns a night in one line."""
    if point is None:
        return f"{day(night.begun_at_s)}: {night.left_out or 'no episode'}"
    where = in_worlds(len(point.worlds))
    rate = f"{100 * point.rate:.1f} % ({100 * point.lower:.1f} to {100 * point.upper:.1f}) {where}"
    said = (("drove the same as before", point.repeats), ("ended early", night.early))
    notes = [note for note, there in said if there]
    counts = f"{point.count.successes:,} of {point.count.n:,}"
    return "; ".join([f"{day(night.begun_at_s)}: {rate}, {counts}", night.bundle_names(), *notes])
