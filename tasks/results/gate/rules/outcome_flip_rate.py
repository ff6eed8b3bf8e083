"""The rule ``maxOutcomeFlipRate``: C MuJoCo comes to the same success often enough, by the parity audit."""

from collections.abc import Iterator
from typing import NamedTuple

from specs.data.parity_audit import AuditReport, FlipShare
from specs.pipeline.gate_section import FlipRate
from specs.pipeline.simulation_section import MAX_AUDITED_LANES
from tasks.results.gate.rules.rule import Completeness, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.rule_answers import answer_below, confidence_text, nothing_counted, rate_text, sentence
from tasks.results.statistics.intervals import Interval, Stratum, lanes_needed, total_interval, total_rate

_METHOD = "stratified exact"
_NOT_COMPARED = frozenset({"NOT COMPARED", "NOT RUN"})


class _Counted(NamedTuple):
    """What an audit counted: lanes, those that flipped, the rate that this says of the batch, and its interval."""

    lanes: int
    flips: int
    rate: float
    interval: Interval
    said: str


def _judge(asked: FlipRate, material: GateMaterial, label: str) -> RuleVerdict:
    audit = material.audit
    why_not = _why_not(audit)
    found = _counted(audit, asked.confidence) if audit and not why_not else None
    if found is None:
        return nothing_counted(label, why_not or "the audit compared no episode")
    answer = answer_below(found.interval, asked.atMost, found.lanes, sound=True)
    text = rate_text(found.rate, found.interval, asked.confidence, _METHOD)
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(
            answer, f"{found.said} ({text})", f"at most {100 * asked.atMost:g} % asked for", Completeness()
        ),
        method=_METHOD,
        counted=found.lanes,
        estimate=found.rate,
        lower=found.interval.lower,
        upper=found.interval.upper,
        facts={"flips": found.flips},
    )


def _counted(audit: AuditReport, confidence: float) -> _Counted | None:
    """Returns what an audit counted, or None if it counted nothing."""
    shares = [(share, what) for share, what in _strata(audit) if share.lanes]
    if not shares:
        return None
    strata = [Stratum(share.episodes, share.effective, share.rate or 0.0) for share, _ in shares]
    lanes, flips = sum(share.lanes for share, _ in shares), sum(share.flips for share, _ in shares)
    parts = [f"{share.text()} {what}" for share, what in shares]
    said = f"of {lanes} audited episodes {flips} flip on C MuJoCo: {', '.join(parts)}"
    return _Counted(lanes, flips, total_rate(strata), total_interval(strata, confidence), said)


def _strata(audit: AuditReport) -> tuple[tuple[FlipShare, str], ...]:
    return (audit.false_passes, "passes that fail there"), (audit.false_alarms, "failures that pass there")


def _why_not(audit: AuditReport | None) -> str:
    """Returns what keeps the audit's episodes from being counted, or nothing."""
    if audit is None:
        return "the batch was not audited"
    if audit.verdict in _NOT_COMPARED:
        return f"the parity audit is {audit.verdict}: {audit.sentence}"
    if audit.unreproduced:
        return f"the parity audit could not make all rows again: {audit.sentence}"
    return ""


def _plan(asked: FlipRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at most {100 * asked.atMost:g} % end otherwise on C MuJoCo, {confidence_text(asked.confidence)}"
    needed = lanes_needed(asked.atMost, asked.confidence)
    enough = "ENOUGH" if planned.audited >= needed else "NOT ENOUGH"
    yield f"if all pass and none does, {needed} audited are needed: {planned.audited} are {enough}"
    if needed > MAX_AUDITED_LANES:
        yield f"no batch audits more than {MAX_AUDITED_LANES}: allow more flips"


OUTCOME_FLIP_RATE = GateRule("maxOutcomeFlipRate", _judge, _plan)
