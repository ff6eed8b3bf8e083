"""The engine's part in a gate's doubt: what passes by the batch's engine, and fails on C MuJoCo.

A few audited lanes never show that an engine is without fault: of 32 without a false pass up to 11 % may be false. Were
that taken off every rate, no gate would ever pass. So doubt counts where there is reason for it: where the parity audit
saw a pass that fails on C MuJoCo, which C MuJoCo does not flip by itself, and chance does not explain. Then its
uncertainty and that of the rate are joined, and an answer that does not stand it is INCONCLUSIVE
(docs/decisions/0028).
"""

from collections.abc import Mapping
from typing import Literal, cast

from pydantic import JsonValue

from specs.base import Spec
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import CollisionRate, SuccessRate
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.strata import Stratum, less_lost, stratum_interval

DOUBT_CHANCE = 0.2
"""How likely chance may give so many flips, for them to count; a reason for doubt needs less than an accusation."""
Direction = Literal["false_passes", "missed_contacts"]


class EngineDoubt(Spec):
    """How much of what went well by the batch's engine may not go well on C MuJoCo.

    Attributes:
        flips: Audited lanes that did not, and that C MuJoCo does not flip by itself.
        lanes: Audited lanes.
        rate: Their share, weighted, 0-1.
        upper: The upper bound of it.
    """

    flips: int
    lanes: int
    rate: float
    upper: float


def engine_doubt(audit: Mapping[str, JsonValue] | None, direction: Direction, confidence: float) -> EngineDoubt | None:
    """Returns the doubt that an audit gives reason for; None if it gives none, or is of an older version.

    Args:
        audit: As the batch's record has it; None if there was none.
        direction: Passes that fail on C MuJoCo, or episodes without a contact that have one there.
        confidence: Coverage of the interval, between 0 and 1.
    """
    share = (audit or {}).get(direction)
    if not isinstance(share, dict) or not share.get("beyond"):
        return None
    chance = share.get("chance")
    if chance is not None and cast("float", chance) >= DOUBT_CHANCE:
        return None
    flips, chaotic, lanes = (cast("int", share[name]) for name in ("flips", "chaotic", "lanes"))
    episodes, effective, beyond = (cast("float", share[name]) for name in ("episodes", "effective", "beyond"))
    bounds = stratum_interval(Stratum(episodes, effective, beyond), confidence)
    return EngineDoubt(flips=flips - chaotic, lanes=lanes, rate=beyond, upper=bounds.upper)


def with_engine_doubt(answer: RuleVerdict, asked: Spec, audit: Mapping[str, JsonValue] | None) -> RuleVerdict:
    """Returns a rule's answer, its interval widened by what may be the engine's; only a PASS can change, to less.

    Args:
        answer: The rule's own answer.
        asked: What the document asks for.
        audit: As the batch's record has it; None if there was none.
    """
    if answer.verdict != "PASS" or answer.estimate is None or answer.lower is None or answer.upper is None:
        return answer
    match asked:
        case SuccessRate():
            doubt = engine_doubt(audit, "false_passes", asked.confidence)
            if doubt is None:
                return answer
            lower = less_lost(answer.estimate, answer.lower, doubt.rate, doubt.upper)
            said = f"up to {_points(answer.estimate * doubt.upper)} points of these passes may be the engine's"
            seen = f"{doubt.flips} of {doubt.lanes} audited passes fail on C MuJoCo, and no micrometre explains it"
            return _changed(answer, {"lower": lower}, f"{said}: {seen}", stands=lower >= asked.atLeast)
        case CollisionRate():
            doubt = engine_doubt(audit, "missed_contacts", asked.confidence)
            if doubt is None:
                return answer
            upper = 1.0 - less_lost(1.0 - answer.estimate, 1.0 - answer.upper, doubt.rate, doubt.upper)
            said = f"up to {_points((1.0 - answer.estimate) * doubt.upper)} points more may collide on C MuJoCo"
            seen = f"{doubt.flips} of {doubt.lanes} audited episodes without a contact have one there"
            return _changed(answer, {"upper": upper}, f"{said}: {seen}", stands=upper <= asked.atMost)
        case _:
            return answer


def _points(share: float) -> str:
    return f"{100 * share:.1f}"


def _changed(answer: RuleVerdict, bound: Mapping[str, float], why: str, *, stands: bool) -> RuleVerdict:
    verdict: Verdict = "PASS" if stands else "INCONCLUSIVE"
    ((name, value),) = bound.items()
    before = cast("float", getattr(answer, name))
    return answer.model_copy(
        update={
            **bound,
            "verdict": verdict,
            "sentence": f"{verdict}{answer.sentence.removeprefix(answer.verdict)}; {why}",
            "facts": {**answer.facts, "engine_doubt": abs(value - before)},
        }
    )
