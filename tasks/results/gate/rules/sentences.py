"""The answers and sentences that the rules of a gate share."""

import math
from collections.abc import Iterator, Mapping

from pydantic import JsonValue

from specs.data.run_report import Verdict
from tasks.results.gate.rules.rule import Completeness, PlannedEpisodes, RuleVerdict
from tasks.results.statistics.intervals import Interval, wilson
from tasks.results.statistics.looks.anytime import confidence_sequence
from tasks.results.statistics.power.episodes_needed import episodes_needed, episodes_needed_at_any_look


def share_interval(count: int, n: int, confidence: float, lacks: Completeness) -> tuple[Interval, str]:
    """Returns the interval of a share, and what the interval is called.

    Args:
        count: Episodes that show it.
        n: All episodes.
        confidence: Coverage, between 0 and 1.
        lacks: Says whether the batch may have been ended by what was counted.
    """
    if lacks.sequential:
        return confidence_sequence(count, n, confidence), "confidence sequence"
    return wilson(count, n, confidence), "Wilson"


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
    kind = "interval at any look" if method == "confidence sequence" else "interval"
    return f"{100 * rate:.1f} %, {100 * confidence:g} % {kind} {percent_text(interval)}"


def percent_text(interval: Interval) -> str:
    """Returns the bounds of a share in percent, rounded outwards."""
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    return f"{lower:.1f} to {upper:.1f} %"


def confidence_text(confidence: float) -> str:
    """Returns how sure a rule has to be."""
    return f"{100 * confidence:g} % confidence"


def share_needed(planned: PlannedEpisodes, at_least: float, confidence: float, rate: float) -> int | None:
    """Returns how many episodes show that a share is high enough; None if no number does.

    Args:
        planned: Says whether the gate is asked after each chunk.
        at_least: The bar, 0-1.
        confidence: Coverage of the interval.
        rate: The share that one expects.
    """
    return (episodes_needed_at_any_look if planned.any_look else episodes_needed)(at_least, confidence, rate)


def needed_line(case: str, needed: int | None, there: int, what: str = "") -> Iterator[str]:
    """Yields how many episodes are needed in a case, and whether they are there; nothing if no number is enough.

    Args:
        case: The case, such as ``if 98 % pass``.
        needed: How many it needs.
        there: How many there are.
        what: What is counted, where it is not all episodes.
    """
    if needed is not None:
        verb = "is" if there == 1 else "are"
        needs = "is" if needed == 1 else "are"
        enough = "enough" if there >= needed else "NOT ENOUGH"
        yield f"{case}, {needed}{what} {needs} needed: {there} {verb} {enough}"
