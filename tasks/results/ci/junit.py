"""A run as JUnit XML, as Jenkins, GitLab and others read it: a suite for each world, a case for each group of episodes.

Before these come the stages of the run, and the gate with a case for each of its rules. A ``failure`` is about what
came of it; an ``error`` says that code failed: an application's, a stage's, Simyard's own. A run whose gate says PASS
has neither. The time of a stage is in wall seconds, that of a group in simulated seconds.
"""

import io
from collections.abc import Iterable, Iterator

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite
from junitparser.junitparser import FinalResult

from specs.data.run_report import StageReport
from specs.untrusted_text import xml_text
from tasks.results.ci.full_report import CountedBatch, FullReport, GateReport, GroupReport
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import IntervalFamily, in_worlds, percent, percent_range

_LONGEST = 1_000
_FINE = frozenset({"Completed", "Succeeded", "PartialFailed"})
_NOT_PASSED = "episodes did not pass"
_WALL, _SIMULATED = "wall seconds", "simulated seconds"


def junit_xml(report: FullReport) -> bytes:
    """Returns the report as a JUnit file, the same bytes for the same report."""
    found = JUnitXml(_line(report.document))
    found.extend(_suites(report))
    found.update_statistics()
    body = io.BytesIO()
    found.write(body)
    return body.getvalue() + b"\n"


def _suites(report: FullReport) -> Iterator[TestSuite]:
    name, batch = report.document, report.batch
    yield _suite(name, "run", _run_cases(report), _WALL, run=report.run, store=report.store)
    if report.gate:
        yield _suite(name, "gate", list(map(_rule_case, report.gate.rules)) or [_gate_case(report.gate)], _WALL)
    if batch:
        for world in batch.worlds:
            cases = (_group_case(group, batch) for group in world.groups)
            yield _suite(name, world.label, cases, _SIMULATED, world=world.world, batch=batch.arn)
        if batch.left_out:
            text = f"{batch.left_out} groups more are not listed here; the batch's tables have them"
            bad = f"{batch.left_out_failed} of {batch.left_out} groups more are not as they should be"
            result = _result(Failure, bad, _NOT_PASSED, text) if batch.left_out_failed else None
            yield _suite(name, "other worlds", [_case("groups that are not listed", result, text)], _SIMULATED)


def _run_cases(report: FullReport) -> Iterator[TestCase]:
    """Yields a case for each stage, and for what keeps a run from its end."""
    failure = report.failure
    for stage in report.stages:
        if not (failure and failure.stage == stage.name):
            yield _stage_case(stage)
    if failure:
        faults = [str(fault) for fault in failure.faults]
        text = "\n".join([failure.reason, *faults, *filter(None, [failure.arn])])
        yield _case(failure.stage or "run", _result(Error, failure.reason, failure.code, text))
    if report.problems:
        yield _case("report", _result(Error, report.problems[0], "report", "\n".join(report.problems)))
    if not (report.stages or failure or report.problems):
        yield _case("document")  # a suite has a case


def _stage_case(stage: StageReport) -> TestCase:
    output = "\n".join([stage.summary, *_places(stage)])
    result = None
    if stage.name == "gate":
        return _case(stage.name, output=output, seconds=stage.seconds)  # its rules have a suite of their own
    if stage.status == "Skipped":
        result = _result(Skipped, stage.summary)
    elif stage.status not in _FINE:
        result = _result(Failure, stage.summary, stage.status, output)
    return _case(stage.name, result, output, stage.seconds)


def _places(stage: StageReport) -> Iterator[str]:
    if stage.arn:
        yield stage.arn
    yield from (f"{artefact.label}: {artefact.url}" for artefact in stage.artefacts)
    if "alarm" in stage.facts:
        yield str(stage.facts["alarm"])


def _gate_case(gate: GateReport) -> TestCase:
    said = None if gate.verdict == "PASS" else _result(Failure, gate.sentence, gate.verdict, gate.sentence)
    return _case("gate", said, gate.sentence)


def _rule_case(rule: RuleVerdict) -> TestCase:
    said = None if rule.verdict == "PASS" else _result(Failure, rule.sentence, rule.verdict, rule.sentence)
    name = rule.rule if rule.title == rule.rule else f"{rule.rule}: {rule.title}"
    return _case(name, said, rule.sentence)


def _group_case(group: GroupReport, batch: CountedBatch) -> TestCase:
    output = "\n".join(_group_lines(group, batch.family()))
    message = f"{group.passed} of {group.episodes} episodes passed"
    if group.state == "skipped":
        return _case(group.name, _result(Skipped, group.note), output, group.simulated_s)
    if group.state == "passed":
        return _case(group.name, output=output, seconds=group.simulated_s)
    asked = "" if batch.bar is None else f"; {percent(batch.bar)} are asked for"
    reasons = ", ".join(f"{each.episodes} x {each.reason}" for each in group.reasons)
    kind, name = (Error, "code failed") if group.state == "error" else (Failure, _NOT_PASSED)
    return _case(group.name, _result(kind, f"{message}{asked}: {reasons}", name, output), seconds=group.simulated_s)


def _group_lines(group: GroupReport, family: IntervalFamily) -> Iterator[str]:
    counts = f"{group.passed} of {group.episodes} episodes passed"
    if group.rate is None:
        yield counts
    else:
        where = in_worlds(1)
        sure = f"interval {percent_range(group.together)}; {family.sentence('batches')}"
        yield f"{counts}: {percent(group.rate)} {where} ({sure})"
        yield f"by itself: {100 * family.confidence:g}\u00a0% interval {percent_range(group.interval)} {where}"
    if group.crashed:
        yield f"{group.crashed} failed because code failed"
    if group.canceled:
        yield f"{group.canceled} were canceled"
    if group.note:
        yield group.note
    yield from (f"{each.episodes} x {each.reason}" for each in group.reasons)
    for example in group.examples:
        why = f": {example.explanation}" if example.explanation else ""
        yield f"seed {example.seed}, {example.reason}{why}\n  {example.job}\n  {example.replay}"


def _suite(document: str, name: str, cases: Iterable[TestCase], unit: str, **properties: str) -> TestSuite:
    """Returns a suite of cases whose times have a unit."""
    suite = TestSuite(_line(name))
    for key, value in {**properties, "time": unit}.items():
        if value:
            suite.add_property(key, _line(value))
    for case in cases:
        case.classname = f"{_line(document)}.{_line(name)}"
        suite.append(case)
    return suite


def _case(name: str, result: FinalResult | None = None, output: str = "", seconds: float = 0.0) -> TestCase:
    """Returns a case; the output is shown with it whether it passed or not."""
    case = TestCase(_line(name), time=round(seconds, 3))
    if result:
        case.result = result
    if output:
        case.system_out = xml_text(output)
    return case


def _result(kind: type[FinalResult], message: str, name: str = "", text: str = "") -> FinalResult:
    """Returns why a case is not passed: what JUnit calls it, in a line, its type, and what happened in many lines."""
    result = kind(_line(message), _line(name))
    if text:
        result.text = xml_text(text)
    return result


def _line(text: str) -> str:
    line = xml_text(" ".join(text.split()))
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
