"""A run as JUnit XML, as Jenkins, GitLab and others read it: a suite for each world, a case for each group of episodes.

Before these come the stages of the run, and the gate with a case for each of its rules. A ``failure`` is about what
came of it; an ``error`` says that code failed: an application's, a stage's, Simyard's own. A run whose gate says PASS
has neither. The time of a stage is in wall seconds, that of a group in simulated seconds.
"""

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

from specs.data.run_report import StageReport
from specs.untrusted_text import xml_text
from tasks.results.ci.full_report import CountedBatch, FullReport, GateReport, GroupReport, RunFailure, WorldReport
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import IntervalFamily, in_worlds, percent, percent_range

Kind = Literal["failure", "error", "skipped"]
_LONGEST = 1_000
_FINE = frozenset({"Completed", "Succeeded", "PartialFailed"})
_WALL, _SIMULATED = "wall seconds", "simulated seconds"


class Trouble(NamedTuple):
    """Why a case is not passed: what JUnit calls it, its type, and what happened, in a line and in many."""

    kind: Kind
    type: str
    message: str
    text: str = ""


class Case(NamedTuple):
    """A test case; ``output`` is shown with it whether it passed or not."""

    name: str
    seconds: float = 0.0
    trouble: Trouble | None = None
    output: str = ""


class Suite(NamedTuple):
    """A test suite: its name, its cases, the unit of their times, and what is known of it."""

    name: str
    cases: tuple[Case, ...]
    unit: str
    properties: tuple[tuple[str, str], ...] = ()


def junit_xml(report: FullReport) -> bytes:
    """Returns the report as a JUnit file, the same bytes for the same report."""
    suites = tuple(_suites(report))
    cases = [case for suite in suites for case in suite.cases]
    root = ET.Element("testsuites", {"name": _line(report.document), **_counts(cases)})
    for suite in suites:
        _add_suite(root, report.document, suite)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _suites(report: FullReport) -> Iterator[Suite]:
    yield Suite("run", tuple(_run_cases(report)), _WALL, (("run", report.run), ("store", report.store)))
    if report.gate:
        yield Suite("gate", tuple(map(_rule_case, report.gate.rules)) or (_gate_case(report.gate),), _WALL)
    if report.batch:
        yield from (_world_suite(world, report.batch) for world in report.batch.worlds)
        if report.batch.left_out:
            yield _rest(report.batch)


def _run_cases(report: FullReport) -> Iterator[Case]:
    """Yields a case for each stage, and for what keeps a run from its end."""
    failure = report.failure
    for stage in report.stages:
        if not (failure and failure.stage == stage.name):
            yield _stage_case(stage)
    if failure:
        yield _failure_case(failure)
    if report.problems:
        yield Case("report", trouble=Trouble("error", "report", report.problems[0], "\n".join(report.problems)))
    if not (report.stages or failure or report.problems):
        yield Case("document")  # a suite has a case


def _stage_case(stage: StageReport) -> Case:
    output = "\n".join([stage.summary, *_places(stage)])
    trouble = None
    if stage.name == "gate":
        return Case(stage.name, stage.seconds, None, output)  # its rules have a suite of their own
    if stage.status == "Skipped":
        trouble = Trouble("skipped", stage.status, stage.summary)
    elif stage.status not in _FINE:
        trouble = Trouble("failure", stage.status, stage.summary, output)
    return Case(stage.name, stage.seconds, trouble, output)


def _places(stage: StageReport) -> Iterator[str]:
    if stage.arn:
        yield stage.arn
    yield from (f"{artefact.label}: {artefact.url}" for artefact in stage.artefacts)
    if "alarm" in stage.facts:
        yield str(stage.facts["alarm"])


def _failure_case(failure: RunFailure) -> Case:
    faults = [str(fault) for fault in failure.faults]
    text = "\n".join([failure.reason, *faults, *filter(None, [failure.arn])])
    return Case(failure.stage or "run", trouble=Trouble("error", failure.code, failure.reason, text))


def _gate_case(gate: GateReport) -> Case:
    said = None if gate.verdict == "PASS" else Trouble("failure", gate.verdict, gate.sentence, gate.sentence)
    return Case("gate", trouble=said, output=gate.sentence)


def _rule_case(rule: RuleVerdict) -> Case:
    said = None if rule.verdict == "PASS" else Trouble("failure", rule.verdict, rule.sentence, rule.sentence)
    name = rule.rule if rule.title == rule.rule else f"{rule.rule}: {rule.title}"
    return Case(name, trouble=said, output=rule.sentence)


def _world_suite(world: WorldReport, batch: CountedBatch) -> Suite:
    known = (("world", world.world), ("batch", batch.arn))
    return Suite(world.label, tuple(_group_case(group, batch) for group in world.groups), _SIMULATED, known)


def _group_case(group: GroupReport, batch: CountedBatch) -> Case:
    output = "\n".join(_group_lines(group, batch.family()))
    message = f"{group.passed} of {group.episodes} episodes passed"
    if group.state == "skipped":
        return Case(group.name, group.simulated_s, Trouble("skipped", "Canceled", group.note), output)
    if group.state == "passed":
        return Case(group.name, group.simulated_s, None, output)
    asked = "" if batch.bar is None else f"; {percent(batch.bar)} are asked for"
    reasons = ", ".join(f"{each.episodes} x {each.reason}" for each in group.reasons)
    kind, name = ("error", "code failed") if group.state == "error" else ("failure", "episodes did not pass")
    return Case(group.name, group.simulated_s, Trouble(kind, name, f"{message}{asked}: {reasons}", output), output="")


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


def _rest(batch: CountedBatch) -> Suite:
    message = f"{batch.left_out} groups more are not listed here; the batch's tables have them"
    bad = f"{batch.left_out_failed} of {batch.left_out} groups more are not as they should be"
    trouble = Trouble("failure", "episodes did not pass", bad, message) if batch.left_out_failed else None
    return Suite("other worlds", (Case("groups that are not listed", 0.0, trouble, message),), _SIMULATED)


def _add_suite(root: ET.Element, document: str, suite: Suite) -> None:
    name = _line(suite.name)
    found = ET.SubElement(root, "testsuite", {"name": name, **_counts(suite.cases)})
    properties = ET.SubElement(found, "properties")
    for key, value in (*suite.properties, ("time", suite.unit)):
        if value:
            ET.SubElement(properties, "property", {"name": key, "value": _line(value)})
    for case in suite.cases:
        _add_case(found, f"{_line(document)}.{name}", case)


def _add_case(suite: ET.Element, class_name: str, case: Case) -> None:
    shown = {"name": _line(case.name), "classname": class_name, "time": _seconds(case.seconds)}
    found = ET.SubElement(suite, "testcase", shown)
    if trouble := case.trouble:
        said = {"message": _line(trouble.message)}
        kind = {} if trouble.kind == "skipped" else {"type": _line(trouble.type)}
        ET.SubElement(found, trouble.kind, kind | said).text = xml_text(trouble.text) or None
    if case.output:
        ET.SubElement(found, "system-out").text = xml_text(case.output)


def _counts(cases: Iterable[Case]) -> dict[str, str]:
    """Returns the attributes of a suite; those of the root sum up all cases."""
    listed = list(cases)
    kinds = [case.trouble.kind for case in listed if case.trouble]
    return {
        "tests": str(len(listed)),
        "failures": str(kinds.count("failure")),
        "errors": str(kinds.count("error")),
        "skipped": str(kinds.count("skipped")),
        "time": _seconds(sum(case.seconds for case in listed)),
    }


def _seconds(seconds: float) -> str:
    return f"{seconds:.3f}"


def _line(text: str) -> str:
    line = xml_text(" ".join(text.split()))
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
