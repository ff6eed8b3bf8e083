"""The gate's answer, from its evidence."""

from pydantic import BaseModel, ConfigDict, ValidationError

from specs.data.run_report import Verdict
from specs.errors import ObjectNotFound
from tasks.results.gate.evidence import EVIDENCE_FILE, Evidence, read_evidence
from tasks.results.gate.shipped_builds import shipment_lines
from tasks.results.report.facts import Judgement, RuleAnswer
from tasks.results.statistics.intervals import Interval
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store

_CONFIDENCE = 0.95
_RATE = "successRate"


class _AnyEvidence(BaseModel):
    """What evidence of any version says."""

    model_config = ConfigDict(extra="ignore")

    verdict: Verdict
    sentence: str


def read_judgement(store: Store, batch: str) -> Judgement | None:
    """Returns what the gate answered on a batch; None where it was not judged.

    Of evidence that another version wrote, verdict and sentence alone.

    Raises:
        ValidationError: What lies there is no evidence.
    """
    try:
        evidence = read_evidence(store, batch)
    except ObjectNotFound:
        return None
    except ValidationError:
        found = _AnyEvidence.model_validate_json(store.get(result_key(batch, EVIDENCE_FILE)).body)
        return Judgement(verdict=found.verdict, sentence=found.sentence, at_least=None, confidence=_CONFIDENCE)
    return judgement_of(evidence)


def judgement_of(evidence: Evidence) -> Judgement:
    """Returns what evidence says of the gate's answer."""
    rate, rules = evidence.rule.successRate, evidence.rules
    judged = evidence.judged_robots()
    alone = () if judged == evidence.robots else judged
    answer = next((each for each in rules if each.rule == _RATE), None)
    return Judgement(
        verdict=evidence.verdict,
        sentence=evidence.sentence,
        at_least=rate.atLeast if rate else None,
        confidence=rate.confidence if rate else _CONFIDENCE,
        rate=answer.estimate if answer else None,
        interval=_interval(answer.lower, answer.upper) if answer else None,
        method=answer.method if answer else "",
        over_worlds=bool(rate and rate.over),
        sequential=bool(evidence.rule.stopEarly),
        rules=tuple(RuleAnswer(name=each.title, verdict=each.verdict, sentence=each.sentence) for each in rules),
        alone=", ".join(f"{robot.name} version {robot.version}" for robot in alone),
        digests=tuple(robot.digest for robot in alone),
        ships=tuple(shipment_lines(evidence.ships)) if evidence.ships else (),
    )


def _interval(lower: float | None, upper: float | None) -> Interval | None:
    return None if lower is None or upper is None else Interval(lower=lower, upper=upper)
