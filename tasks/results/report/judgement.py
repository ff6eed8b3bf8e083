"""The gate's answer, from its evidence."""

from specs.errors import ObjectNotFound
from tasks.results.evidence import Evidence, read_evidence
from tasks.results.report.facts import Judgement, RuleAnswer
from tasks.storage.store import Store

_CONFIDENCE = 0.95


def judgement(store: Store, batch: str) -> Judgement | None:
    """Returns what the gate answered on a batch; None where it was not judged.

    Raises:
        ValidationError: Its evidence is none that this version wrote.
    """
    try:
        evidence = read_evidence(store, batch)
    except ObjectNotFound:
        return None
    return judged(evidence)


def judged(evidence: Evidence) -> Judgement:
    """Returns what evidence says of the gate's answer."""
    rate, rules = evidence.rule.successRate, evidence.rules
    return Judgement(
        verdict=evidence.verdict,
        sentence=evidence.sentence,
        at_least=rate.atLeast if rate else None,
        confidence=rate.confidence if rate else _CONFIDENCE,
        rules=tuple(RuleAnswer(name=each.rule, verdict=each.verdict, sentence=each.sentence) for each in rules),
    )
