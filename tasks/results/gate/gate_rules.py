"""The rules of a gate, one function each: what they count, the interval of it, and the answer with its sentence.

Each answers PASS when its whole interval is within the bar, FAIL when the whole interval is beyond it, and else
INCONCLUSIVE. What is not known speaks against whoever needs it: where a job crashed before there was anything to
measure, a PASS takes the worst and a FAIL the best. A canceled or missing episode lets nothing pass.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.data.run_report import Verdict as Answer
from specs.pipeline.gate_section import CollisionRate, FlipRate, NoWorseThan, QuantileRule, SuccessRate
from tasks.results.statistics.intervals import Interval, mcnemar, paired_difference, quantile_interval, wilson
from tasks.results.statistics.pairs import Pairs
from tasks.results.statistics.sequential import confidence_sequence
from tasks.results.statistics.success import EpisodeCounts


class RuleVerdict(Spec):
    """One rule's answer.

    Attributes:
        rule: Where it stands in the gate, such as ``successRate`` or ``quantiles[0]``.
        sentence: The answer and why, for a person.
        method: What the interval is: ``Wilson``, ``confidence sequence``, ``Tango`` or ``order statistics``.
        counted: Episodes, or pairs of them.
        estimate: The share, difference or quantile as it was seen; None of nothing.
        lower: Lower bound of the interval; None if it has none.
        upper: Upper bound; None likewise.
        facts: More numbers, by name.
    """

    rule: str
    verdict: Answer
    sentence: str
    method: str = ""
    counted: int = 0
    estimate: float | None = None
    lower: float | None = None
    upper: float | None = None
    facts: dict[str, JsonValue] = Field(default_factory=dict[str, JsonValue])

    @property
    def title(self) -> str:
        """Returns what a person calls the rule: its name in the document, and of a quantile what it is of."""
        return f"quantile of {self.facts['column']}" if "column" in self.facts else self.rule


class Completeness(NamedTuple):
    """What of a batch is not there to be judged.

    Attributes:
        canceled: Episodes that somebody canceled.
        missing: Episodes that never got a result.
        left_out: Episodes that were not needed any more, because the gate was certain.
        sequential: Whether the batch may have been ended by what was counted, so that only a confidence sequence holds.
    """

    canceled: int = 0
    missing: int = 0
    left_out: int = 0
    sequential: bool = False

    def whole(self) -> bool:
        """Returns whether all episodes came to an end."""
        return not (self.canceled or self.missing or self.left_out)

    def text(self) -> list[str]:
        """Returns what a sentence says of it."""
        said = [f"{self.canceled} canceled"] * bool(self.canceled)
        said += [f"{self.missing} without a result"] * bool(self.missing)
        return said + [f"{self.left_out} not needed any more"] * bool(self.left_out)


def success_rule(counts: EpisodeCounts, rule: SuccessRate, lacks: Completeness) -> RuleVerdict:
    """Returns whether enough episodes passed.

    Args:
        counts: What the episodes came to.
        rule: What is asked for.
        lacks: What is not there to be counted.
    """
    interval, method = _share(counts.successes, counts.episodes, rule.confidence, lacks)
    sound = not (lacks.canceled or lacks.missing)
    answer = _above(interval, rule.atLeast, counts.episodes, sound=sound)
    if counts.episodes == 0:
        return _nothing("successRate", "no episode has a result to count")
    rate = counts.successes / counts.episodes
    seen = f"{counts.successes} of {counts.episodes} episodes passed ({_seen(rate, interval, rule.confidence, method)})"
    return RuleVerdict(
        rule="successRate",
        verdict=answer,
        sentence=_sentence(answer, seen, f"at least {100 * rule.atLeast:g} % asked for", lacks),
        method=method,
        counted=counts.episodes,
        estimate=rate,
        lower=interval.lower,
        upper=interval.upper,
        facts={"successes": counts.successes},
    )


def collision_rule(collided: int, unknown: int, n: int, rule: CollisionRate, lacks: Completeness) -> RuleVerdict:
    """Returns whether few enough robots touched anything.

    Args:
        collided: In how many episodes a contact began.
        unknown: In how many others the job failed, so that one might have.
        n: How many episodes there are, these included.
        rule: What is asked for.
        lacks: What is not there to be counted.
    """
    if n == 0:
        return _nothing("collisionRate", "no episode has a result to count")
    lower, method = _share(collided, n, rule.confidence, lacks)
    upper, _ = _share(collided + unknown, n, rule.confidence, lacks)
    interval = Interval(lower=lower.lower, upper=upper.upper)
    answer = _below(interval, rule.atMost, n, sound=not (lacks.canceled or lacks.missing))
    more = f", {unknown} more of jobs that failed" if unknown else ""
    seen = f"collisions in {collided} of {n} episodes{more} ({_seen(collided / n, interval, rule.confidence, method)})"
    return RuleVerdict(
        rule="collisionRate",
        verdict=answer,
        sentence=_sentence(answer, seen, f"at most {100 * rule.atMost:g} % asked for", lacks),
        method=method,
        counted=n,
        estimate=collided / n,
        lower=interval.lower,
        upper=interval.upper,
        facts={"collided": collided, "unknown": unknown},
    )


def quantile_rule(
    name: str, values: Sequence[float], unknown: int, rule: QuantileRule, lacks: Completeness
) -> RuleVerdict:
    """Returns whether a quantile of a column lies where it must.

    Args:
        name: Where the rule stands in the gate.
        values: The column's values that are known.
        unknown: How many episodes have none: their job failed, or there is nothing to measure.
        rule: What is asked for.
        lacks: What is not there to be counted.
    """
    n = len(values) + unknown
    if not values:
        return _nothing(name, f"no episode has a value of {rule.column}", {"column": rule.column})
    worst = quantile_interval([*values, *[-math.inf] * unknown], rule.quantile, rule.confidence).lower
    best = quantile_interval([*values, *[math.inf] * unknown], rule.quantile, rule.confidence).upper
    interval = Interval(lower=worst, upper=best)
    at_least = rule.atLeast is not None
    bar = rule.atLeast if rule.atLeast is not None else rule.atMost or 0.0
    answer = (_above if at_least else _below)(interval, bar, n, sound=lacks.whole())
    of = f"the {rule.quantile:g} quantile of {rule.column} over {n} episodes"
    unseen = f", unknown in {unknown}" if unknown else ""
    estimate = sorted(values)[max(0, math.ceil(rule.quantile * len(values)) - 1)]
    seen = f"{of}{unseen} is {estimate:.4g} ({100 * rule.confidence:g} % interval {_open(interval)})"
    asked = f"at {'least' if at_least else 'most'} {bar:g} asked for"
    return RuleVerdict(
        rule=name,
        verdict=answer,
        sentence=_sentence(answer, seen, asked, lacks),
        method="order statistics",
        counted=n,
        estimate=estimate,
        lower=_finite(interval.lower),
        upper=_finite(interval.upper),
        facts={"column": rule.column, "unknown": unknown},
    )


def no_worse_rule(pairs: Pairs | str, rule: NoWorseThan, lacks: Completeness) -> RuleVerdict:
    """Returns whether the tested version passes as often as another one on the same episodes, less the margin.

    Args:
        pairs: What both came to; or why there are none.
        rule: What is asked for.
        lacks: What is not there to be counted.
    """
    if isinstance(pairs, str) or pairs.n == 0:
        return _nothing("noWorseThan", pairs if isinstance(pairs, str) else "no episode of both versions is the same")
    interval = paired_difference(pairs.gains, pairs.losses, pairs.n, rule.confidence)
    answer = _above(interval, -rule.margin, pairs.n, sound=lacks.whole())
    estimate = (pairs.gains - pairs.losses) / pairs.n
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    seen = (
        f"against version {rule.applicationVersion} on the same {pairs.n} episodes, {pairs.gains} that failed pass now "
        f"and {pairs.losses} that passed fail now: {100 * estimate:+.1f} points "
        f"({100 * rule.confidence:g} % interval {lower:+.1f} to {upper:+.1f})"
    )
    return RuleVerdict(
        rule="noWorseThan",
        verdict=answer,
        sentence=_sentence(answer, seen, f"at most {100 * rule.margin:g} points worse asked for", lacks),
        method="Tango",
        counted=pairs.n,
        estimate=estimate,
        lower=interval.lower,
        upper=interval.upper,
        facts={
            "gains": pairs.gains,
            "losses": pairs.losses,
            "unpaired": pairs.unpaired,
            "mcnemar_p": float(f"{mcnemar(pairs.gains, pairs.losses):.6g}"),
        },
    )


def flip_rule(lanes: int, flips: int, why_not: str, rule: FlipRate) -> RuleVerdict:
    """Returns whether C MuJoCo comes to the same outcomes often enough.

    Args:
        lanes: Episodes spread over the batch that the parity audit drove again on the reference.
        flips: How many of them came to another end.
        why_not: What keeps the audit from counting, or empty.
        rule: What is asked for.
    """
    if why_not or lanes == 0:
        return _nothing("maxOutcomeFlipRate", why_not or "the audit compared no episode")
    interval = wilson(flips, lanes, rule.confidence)
    answer = _below(interval, rule.atMost, lanes, sound=True)
    seen = f"{flips} of {lanes} outcomes are others on C MuJoCo"
    seen += f" ({_seen(flips / lanes, interval, rule.confidence, 'Wilson')})"
    return RuleVerdict(
        rule="maxOutcomeFlipRate",
        verdict=answer,
        sentence=_sentence(answer, seen, f"at most {100 * rule.atMost:g} % asked for", Completeness()),
        method="Wilson",
        counted=lanes,
        estimate=flips / lanes,
        lower=interval.lower,
        upper=interval.upper,
        facts={"flips": flips},
    )


def _share(count: int, n: int, confidence: float, lacks: Completeness) -> tuple[Interval, str]:
    if lacks.sequential:
        return confidence_sequence(count, n, confidence), "confidence sequence"
    return wilson(count, n, confidence), "Wilson"


def _above(interval: Interval, bar: float, n: int, *, sound: bool) -> Answer:
    if n and interval.upper < bar:
        return "FAIL"
    return "PASS" if n and sound and interval.lower >= bar else "INCONCLUSIVE"


def _below(interval: Interval, bar: float, n: int, *, sound: bool) -> Answer:
    if n and interval.lower > bar:
        return "FAIL"
    return "PASS" if n and sound and interval.upper <= bar else "INCONCLUSIVE"


def _nothing(rule: str, why: str, facts: Mapping[str, JsonValue] | None = None) -> RuleVerdict:
    return RuleVerdict(rule=rule, verdict="INCONCLUSIVE", sentence=f"INCONCLUSIVE: {why}", facts=dict(facts or {}))


def _sentence(answer: Answer, seen: str, asked: str, lacks: Completeness) -> str:
    return "; ".join([f"{answer}: {seen}", asked, *lacks.text()])


def _seen(rate: float, interval: Interval, confidence: float, method: str) -> str:
    # Outwards, so that a bound on the wrong side of the bar is never printed as on it.
    lower, upper = math.floor(1000 * interval.lower) / 10, math.ceil(1000 * interval.upper) / 10
    kind = "interval at any look" if method == "confidence sequence" else "interval"
    return f"{100 * rate:.1f} %, {100 * confidence:g} % {kind} {lower:.1f} to {upper:.1f} %"


def _open(interval: Interval) -> str:
    if math.isinf(interval.lower) and math.isinf(interval.upper):
        return "open, too few episodes"
    if math.isinf(interval.lower):
        return f"up to {interval.upper:.4g}"
    return (
        f"from {interval.lower:.4g}" if math.isinf(interval.upper) else f"{interval.lower:.4g} to {interval.upper:.4g}"
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
