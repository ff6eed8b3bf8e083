"""A run as a page of Markdown: the summary of a step of GitHub Actions.

All that a stranger may have written (names of worlds, reasons, sentences with them) stands in code: GitHub makes links
and mentions of what is escaped as well.
"""

from collections.abc import Iterator, Mapping

from specs.artifact_text import code_span
from tasks.results.ci.full_report import Answer, CountedBatch, FullReport, GroupReport, WorldReport
from tasks.results.ci.markdown_blocks import bounded_page, details, table
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.rate_text import percent, percent_range

SUMMARY_BYTES = 1 << 20
"""GitHub takes no longer summary of a step."""
_MOST_WORLDS = 100
_MOST_FAILURES = 50
_SIGNS: Mapping[str, str] = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_ANSWERS: Mapping[Answer, str] = {
    "PASSED": "✅ Passed",
    "NOT PASSED": "❌ Not passed",
    "INCONCLUSIVE": "❔ INCONCLUSIVE",
    "FAILED": "💥 A stage failed",
    "REFUSED": "🚫 The document is refused",
}


def summary_markdown(report: FullReport, most_bytes: int = SUMMARY_BYTES) -> str:
    """Returns the summary of a run, no longer than that many bytes.

    Args:
        report: The run.
        most_bytes: In UTF-8.
    """
    return bounded_page(_blocks(report), most_bytes)


def _blocks(report: FullReport) -> Iterator[str]:
    yield f"## {_ANSWERS[report.answer]}: {code_span(report.document)}"
    yield _why(report)
    if report.gate:
        yield table(("rule", "answer", "seen", "interval", "counted", "why"), map(_rule_row, report.gate.rules))
    yield from (f"- ⚠️ {code_span(problem, 1_000)}" for problem in _alarms(report))
    if report.batch:
        yield from _batch_blocks(report.batch)
    yield details("Stages and files", "\n\n".join(_stages(report)))


def _why(report: FullReport) -> str:
    if report.failure:
        faults = [f"- {code_span(str(fault), 500)}" for fault in report.failure.faults[:40]]
        return "\n".join([f"{code_span(report.failure.code)}: {code_span(report.failure.reason, 1_000)}\n", *faults])
    if report.gate:
        return code_span(report.gate.sentence.splitlines()[0], 1_000)
    return "No gate was asked for, so nobody judged the batch." if report.batch else ""


def _alarms(report: FullReport) -> list[str]:
    alarms = [str(stage.facts["alarm"]) for stage in report.stages if "alarm" in stage.facts]
    return [*alarms, *report.problems]


def _rule_row(rule: RuleVerdict) -> tuple[str, ...]:
    counted = f"{rule.counted:,}" if rule.counted else ""
    seen = "" if rule.estimate is None else f"{rule.estimate:.3f}"
    answer = f"{_SIGNS[rule.verdict]} {rule.verdict}"
    return code_span(rule.title), answer, seen, _bounds(rule), counted, code_span(rule.sentence)


def _bounds(rule: RuleVerdict) -> str:
    if rule.lower is None and rule.upper is None:
        return ""
    low, high = ("" if bound is None else f"{bound:.3f}" for bound in (rule.lower, rule.upper))
    return f"{low} to {high} ({rule.method})"


def _batch_blocks(batch: CountedBatch) -> Iterator[str]:
    yield f"### Episodes\n\n{_counts(batch)}"
    worlds = sorted(batch.worlds, key=_world_rate)
    why = ("world", "passed", "rate", "why not")
    rates = table(why, map(_world_row, worlds[:_MOST_WORLDS]))
    more = f"\n\n{len(worlds) - _MOST_WORLDS} worlds more." if len(worlds) > _MOST_WORLDS else ""
    yield (
        details(f"Rates of {len(batch.worlds)} worlds, the lowest first, each in that world alone", rates + more)
        if rates
        else ""
    )
    yield from _failures(batch, worlds)


def _counts(batch: CountedBatch) -> str:
    rate = "" if batch.rate is None else f": {percent(batch.rate)}"
    canceled = f"; {batch.canceled:,} canceled" if batch.canceled else ""
    sure = f"{100 * batch.confidence:g}\u00a0% interval {percent_range(batch.interval)}"
    counts = f"{batch.passed:,} of {batch.episodes:,} episodes passed{rate} ({sure}) {batch.where()}{canceled}."
    return " ".join([counts, *batch.like_these.sentences()])


def _world_rate(world: WorldReport) -> float:
    return world.passed / world.episodes if world.episodes else 2.0


def _world_row(world: WorldReport) -> tuple[str, ...]:
    rate = percent(world.passed / world.episodes) if world.episodes else "-"
    why: dict[str, int] = {}
    for reason in (each for group in world.groups for each in group.reasons):
        why[reason.reason] = why.get(reason.reason, 0) + reason.episodes
    said = ", ".join(f"{count} x {reason}" for reason, count in sorted(why.items(), key=lambda each: -each[1]))
    return code_span(world.label, 100), f"{world.passed} of {world.episodes}", rate, code_span(said)


def _failures(batch: CountedBatch, worlds: list[WorldReport]) -> Iterator[str]:
    found = [(world, group, example) for world in worlds for group in world.groups for example in group.examples]
    rows = [
        (
            code_span(world.label, 100),
            _group(group),
            str(example.seed),
            code_span(f"{example.reason} {example.explanation}"),
            code_span(example.replay, 500),
        )
        for world, group, example in found[:_MOST_FAILURES]
    ]
    all_failures = batch.episodes - batch.passed
    if rows:
        where = "each command drives its episode again where the store is (docs/guide/ci.md)"
        yield f"### Failures\n\n{len(rows)} of {all_failures:,}; {where}."
        yield table(("world", "group", "seed", "why", "replay"), rows)


def _group(group: GroupReport) -> str:
    return code_span(group.name, 200)


def _stages(report: FullReport) -> Iterator[str]:
    rows = (
        (stage.name, code_span(stage.status), f"{stage.seconds:.1f}", code_span(stage.summary))
        for stage in report.stages
    )
    yield table(("stage", "status", "seconds", "what came of it"), rows)
    yield "\n".join(
        f"- {stage.name}, {code_span(artefact.label)}: {code_span(artefact.url, 500)}"
        for stage in report.stages
        for artefact in stage.artefacts
    )
    yield f"Run {code_span(report.run)} in {code_span(report.store, 500)}" if report.run else ""
