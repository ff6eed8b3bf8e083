"""The answers and sentences that the rules of a gate share."""

import math
from collections.abc import Mapping

from pydantic import JsonValue

from specs.data.run_report import Verdict
from tasks.results.gate.rules.rule import Completeness, RuleVerdict
from tasks.results.statistics.intervals import Interval, wilson
from tasks.results.statistics.looks.anytime import confidence_sequence
from tasks.results.statistics.looks.repeated_interval import inner_interval, repeated_interval

AT_LOOKS = "repeated confidence interval"
"""What the interval is called of a batch that was looked at with its end in sight."""


def share_interval(count: int, n: int, confidence: float, lacks: Completeness) -> tuple[Interval, str]:
    """Returns the interval of a share, and what the interval is called.

    Args:
        count: Episodes that show it.
        n: All episodes.
        confidence: Coverage, between 0 and 1.
        lacks: Says whether the batch may have been ended by what was counted.
    """
    if lacks.sequential and lacks.looks:
        return _interval_at_look(count, n, confidence, lacks), AT_LOOKS
    if lacks.sequential:
        return confidence_sequence(count, n, confidence), "confidence sequence"
    return wilson(count, n, confidence), "Wilson"


def _interval_at_look(count: int, n: int, confidence: float, lacks: Completeness) -> Interval:
    """Returns the interval of a share at a look, whatever the episodes would have shown that were not counted there."""
    interval, whole = inner_interval if lacks.inner else repeated_interval, lacks.look(n)
    lower = interval(count, whole, lacks.looks, confidence).lower
    return Interval(lower=lower, upper=interval(count + whole - n, whole, lacks.looks, confidence).upper)


def answer_above(interval: Interval, bar: float, n: int, *, sound: bool) -> Verdict:
    """Returns the answer of a rule whose interval has to be above a bar.

    Args:
        interval: Of what the rule is about.
        bar: The least that passes.
        n: How many were counted; of none nothing is known.
        sound: Whether nothing is missing that might have made it worse.
    """
    if n and interval.upper < bar:
        return "FAIL"
    return "PASS" if n and sound and interval.lower >= bar else "INCONCLUSIVE"


def answer_below(interval: Interval, bar: float, n: int, *, sound: bool) -> Verdict:
    """Returns the answer of a rule whose interval has to be below a bar.

    Args:
        interval: Of what the rule is about.
        bar: The most that passes.
        n: How many were counted; of none nothing is known.
        sound: Whether nothing is missing that might have made it worse.
    """
    if n and interval.lower > bar:
        return "FAIL"
    return "PASS" if n and sound and interval.upper <= bar else "INCONCLUSIVE"


def nothing_counted(rule: str, why: str, facts: Mapping[str, JsonValue] | None = None) -> RuleVerdict:
    """Returns the answer of a rule that has nothing to judge by."""
    return RuleVerdict(rule=rule, verdict="INCONCLUSIVE", sentence=f"INCONCLUSIVE: {why}", facts=dict(facts or {}))


def sentence(answer: Verdict, seen: str, asked: str, lacks: Completeness, note: str = "") -> str:
    """Returns an answer with its reason.

    Args:
        answer: The answer.
        seen: What was seen.
        asked: What the document asks for.
        lacks: What was not there to be counted.
        note: What else is to be known; empty for nothing.
    """
    return "; ".join([f"{answer}: {seen}", asked, *lacks.text(), *[note] * bool(note)])


def rate_text(rate: float, interval: Interval, confidence: float, method: str) -> str:
    """Returns a rate with its interval.

    Args:
        rate: The share that was seen.
        interval: Rounded outwards, so that a bound on the wrong side of the bar is never printed as on it.
        confidence: Its coverage.
        method: What it is called.
    """
    kind = "interval at any look" if method in (AT_LOOKS, "confidence sequence") else "interval"
    return f"{100 * rate:.1f} %, {100 * confidence:g} % {kind} {percent_text(interval)}"


def percent_text(interval: Interval) -> str:
    """Returns the bounds of a share in percent, rounded outwards."""
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    return f"{lower:.1f} to {upper:.1f} %"


def confidence_text(confidence: float) -> str:
    """Returns how sure a rule has to be."""
    return f"{100 * confidence:g} % confidence"


def about(over: str | None) -> str:
    """Returns what `simyard plan` adds to a rule that is about worlds like these."""
    return " in worlds like these" if over == "worlds" else ""
