"""The rule ``successRate``: enough episodes pass."""

from collections.abc import Iterator, Sequence

from specs.pipeline.gate_section import SuccessRate
from tasks.results.gate.missing_data import ASSUMED, gap_of
from tasks.results.gate.rules.rule import ColumnValues, GateMaterial, GateRule, PlannedEpisodes, RuleVerdict, Share
from tasks.results.gate.rules.rule_answers import (
    about,
    answer_above,
    confidence_text,
    nothing_counted,
    rate_of,
    rate_text,
    sentence,
    share_lines,
)

_COLUMNS = ("status", "failure_code", "outcome")
_EXPECTED_RATES = (1.0, 0.98, 0.95)


def _columns(_: SuccessRate) -> Sequence[str]:
    return _COLUMNS


def _count(values: ColumnValues) -> Share:
    """Returns how many episodes passed; one without an outcome to rely on is what the table of missing data says."""
    passed = unknown = 0
    for status, code, outcome in zip(*(values[name] for name in _COLUMNS), strict=True):
        gap = gap_of(status, code)
        if gap is None:
            passed += outcome == "Passed"
        else:
            unknown += ASSUMED["successRate"][gap].blame == "best"
    return Share(passed, unknown, len(values["status"]))


def _judge(asked: SuccessRate, material: GateMaterial, label: str) -> RuleVerdict:
    counts = material.counts
    share = material.shares.get(label) or Share(counts.successes, counts.failed_jobs, counts.episodes)
    if share.n == 0:
        return nothing_counted(label, "no episode has a result to count")
    found = rate_of(asked, "successRate", share, material, label)
    if isinstance(found, str):
        return nothing_counted(label, found)
    answer = answer_above(found.interval, asked.atLeast, share.n, sound=not found.blocks)
    rate = share.shown / share.n
    text = rate_text(rate, found.interval, asked.confidence, found.method)
    more = f", {share.unknown} more of jobs that failed by no fault of the robot" if share.unknown else ""
    seen = f"{share.shown} of {share.n} episodes passed{found.where}{more} ({text})"
    return RuleVerdict(
        rule=label,
        verdict=answer,
        sentence=sentence(answer, seen, f"at least {100 * asked.atLeast:g} % asked for", material.lacks, found.note),
        method=found.method,
        counted=share.n,
        estimate=rate,
        lower=found.interval.lower,
        upper=found.interval.upper,
        facts={"successes": share.shown, "unknown": share.unknown, **found.facts},
    )


def _plan(asked: SuccessRate, planned: PlannedEpisodes) -> Iterator[str]:
    yield f"at least {100 * asked.atLeast:g} % pass{about(asked.over)}, {confidence_text(asked.confidence)}"
    over = asked.over == "worlds"
    for rate in _EXPECTED_RATES:
        case = f"if {100 * rate:g} % pass"
        yield from share_lines(case, planned, asked.atLeast, asked.confidence, rate, over_worlds=over)


SUCCESS_RATE = GateRule("successRate", _judge, _plan, _columns, _count)
