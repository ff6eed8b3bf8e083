"""The rule ``maxOutcomeFlipRate``: C MuJoCo comes to the same outcomes often enough, by the parity audit."""

from collections.abc import Iterator, Mapping
from typing import cast

from pydantic import JsonValue

from specs.pipeline.gate_section import FlipRate
from tasks.results.gate.rules.power_lines import power_line
from tasks.results.gate.rules.rule import Completeness, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.sentences import (
    answer_below,
    confidence_text,
    nothing_counted,
    rate_text,
    sentence,
)
from tasks.results.statistics.intervals import wilson
from tasks.results.statistics.power.shares import share_needs

_NOT_COMPARED = frozenset({"NOT COMPARED", "NOT RUN"})


def _judge(asked: FlipRate, material: GateMaterial, label: str) -> RuleVerdict:
    audit = material.audit
    why_not = _why_not(audit)
    spread = cast("Mapping[str, int]", audit["spread"]) if audit and not why_not else {"lanes": 0, "flips": 0}
    lanes, flips = spread["lanes"], spread["flips"]
    if lanes == 0:
        return nothing_counted(label, why_not or "the audit compared no episode")
    interval = wilson(flips, lanes, asked.confidence)
    answer = answer_below(interval, asked.atMost, lanes, sound=True)
    seen = f"{flips} of {lanes} outcomes are others on C MuJoCo"
    seen += f" ({rate_text(flips / lanes, interval, asked.confidence, 'Wilson')})"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at most {100 * asked.atMost:g} % asked for", Completeness()),
        method="Wilson",
        counted=lanes,
        estimate=flips / lanes,
        lower=interval.lower,
        upper=interval.upper,
        facts={"flips": flips},
    )


def _why_not(audit: Mapping[str, JsonValue] | None) -> str:
    """Returns what keeps the audit's episodes from being counted, or nothing."""
    if audit is None:
        return "the batch was not audited"
    if audit["verdict"] in _NOT_COMPARED:
        return f"the parity audit is {audit['verdict']}: {audit['sentence']}"
    if audit.get("unreproduced"):
        return f"the parity audit could not make all rows again: {audit['sentence']}"
    return ""


def _plan(asked: FlipRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at most {100 * asked.atMost:g} % end otherwise on C MuJoCo, {confidence_text(asked.confidence)}"
    for case, share in (("if none does", 0.0), (f"if {25 * asked.atMost:g} % do", asked.atMost / 4.0)):
        needs = share_needs(1.0 - asked.atMost, asked.confidence, 1.0 - share, planned.audited)
        yield from power_line(case, needs, planned.audited, "audited")


OUTCOME_FLIP_RATE = GateRule("maxOutcomeFlipRate", _judge, _plan)
