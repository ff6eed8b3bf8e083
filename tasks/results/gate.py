"""The gate: whether the episodes show what the rule asks for, or the opposite, or too little.

PASS needs the whole interval at or above the bar, FAIL the whole interval below it; in between the answer is
INCONCLUSIVE, and more episodes are needed. A canceled or missing episode might have failed, so with one of them nothing
passes.
"""

import math
from statistics import NormalDist

from specs.base import Spec
from specs.pipeline_simulation import SuccessRate
from specs.report import Verdict as Answer
from tasks.results.statistics import Interval, wilson
from tasks.results.success import EpisodeCounts


class GateNumbers(EpisodeCounts):
    """What the verdict rests on.

    Attributes:
        missing: How many never got a result.
        rate: Successes over episodes, or None without episodes.
        interval: Two-sided Wilson interval of the rate.
    """

    missing: int
    rate: float | None
    interval: Interval


class Verdict(Spec):
    """The gate's answer, and why, in one sentence for a person."""

    verdict: Answer
    sentence: str
    numbers: GateNumbers


def judge(counts: EpisodeCounts, rule: SuccessRate, *, missing: int = 0) -> Verdict:
    """Returns the verdict on a batch.

    Args:
        counts: What its episodes came to.
        rule: The success rate asked for.
        missing: How many episodes have no result.
    """
    numbers = _numbers(counts, rule.confidence, missing)
    answer = _answer(numbers, rule.atLeast)
    return Verdict(verdict=answer, sentence=_sentence(answer, numbers, rule), numbers=numbers)


def episodes_needed(at_least: float, confidence: float, assumed_rate: float) -> int | None:
    """Returns the fewest episodes that pass when the assumed share of them, rounded down, succeeds; None if none do.

    The lower Wilson bound reaches the bar exactly when the score test does: share - bar >= z sqrt(bar (1 - bar) / n).

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the two-sided interval.
        assumed_rate: The share of successes that one expects, 0-1.
    """
    if at_least == 0.0:
        return 1
    if assumed_rate <= at_least:
        return None
    spread = NormalDist().inv_cdf((1.0 + confidence) / 2.0) ** 2 * at_least * (1.0 - at_least)
    n = max(1, math.ceil(spread / (assumed_rate - at_least) ** 2))
    while not _reaches(math.floor(assumed_rate * n + 1e-9), n, at_least, spread):
        n += 1
    return n


def _reaches(successes: int, n: int, at_least: float, spread: float) -> bool:
    above = successes / n - at_least
    return above >= 0.0 and above * above * n >= spread


def _numbers(counts: EpisodeCounts, confidence: float, missing: int) -> GateNumbers:
    return GateNumbers(
        **counts.model_dump(),
        missing=missing,
        rate=counts.successes / counts.episodes if counts.episodes else None,
        interval=wilson(counts.successes, counts.episodes, confidence),
    )


def _answer(numbers: GateNumbers, at_least: float) -> Answer:
    if numbers.episodes == 0:
        return "INCONCLUSIVE"
    if numbers.interval.upper < at_least:
        return "FAIL"
    complete = not numbers.canceled and not numbers.missing
    return "PASS" if complete and numbers.interval.lower >= at_least else "INCONCLUSIVE"


def _sentence(answer: Answer, numbers: GateNumbers, rule: SuccessRate) -> str:
    if numbers.rate is None:
        return f"{answer}: no episode has a result to count"
    interval = f"{100 * rule.confidence:g} % interval {_range(numbers.interval)}"
    counted = f"{numbers.successes} of {numbers.episodes} episodes passed ({100 * numbers.rate:.1f} %, {interval})"
    asked = f"at least {100 * rule.atLeast:g} % asked for"
    left_out = [f"{numbers.canceled} canceled"] * bool(numbers.canceled)
    left_out += [f"{numbers.missing} without a result"] * bool(numbers.missing)
    return "; ".join([f"{answer}: {counted}", asked, *left_out])


def _range(interval: Interval) -> str:
    # Outwards, so that a bound on the wrong side of the bar is never printed as on it.
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    return f"{lower:.1f} to {upper:.1f} %"
