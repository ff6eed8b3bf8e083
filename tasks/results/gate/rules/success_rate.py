"""The rule ``successRate``: enough episodes pass."""

from collections.abc import Iterator

from specs.pipeline.gate_section import SuccessRate
from tasks.results.gate.rules.power_lines import share_lines
from tasks.results.gate.rules.rule import GateMaterial, GateRule, PlannedEpisodes, RuleVerdict
from tasks.results.gate.rules.sentences import (
    about,
    answer_above,
    confidence_text,
    nothing_counted,
    rate_text,
    sentence,
    share_interval,
)

_EXPECTED_RATES = (1.0, 0.98, 0.95)


def _judge(asked: SuccessRate, material: GateMaterial, label: str) -> RuleVerdict:
    counts, lacks = material.counts, material.lacks
    if counts.episodes == 0:
        return nothing_counted(label, "no episode has a result to count")
    interval, method = share_interval(counts.successes, counts.episodes, asked.confidence, lacks)
    answer = answer_above(interval, asked.atLeast, counts.episodes, sound=lacks.all_counted())
    rate = counts.successes / counts.episodes
    text = rate_text(rate, interval, asked.confidence, method)
    seen = f"{counts.successes} of {counts.episodes} episodes passed ({text})"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at least {100 * asked.atLeast:g} % asked for", lacks),
        method=method,
        counted=counts.episodes,
        estimate=rate,
        lower=interval.lower,
        upper=interval.upper,
        facts={"successes": counts.successes},
    )


def _plan(asked: SuccessRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at least {100 * asked.atLeast:g} % pass{about(asked.over)}, {confidence_text(asked.confidence)}"
    over = asked.over == "worlds"
    for rate in _EXPECTED_RATES:
        case = f"if {100 * rate:g} % pass"
        yield from share_lines(case, planned, asked.atLeast, asked.confidence, rate, over_worlds=over)


SUCCESS_RATE = GateRule("successRate", _judge, _plan)
