"""A run as annotations of GitHub Actions: workflow commands, such as ``::error title=...::...``, a line each.

GitHub shows ten errors and ten warnings of a step, and drops others without a word.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

from specs.terminal_text import terminal_line
from tasks.results.ci.full_report import FullReport

MOST_OF_A_KIND = 10
_LONGEST = 500
_FAILED = frozenset({"Failed", "Refused", "TimedOut", "Canceled"})
_Level = Literal["error", "warning"]


class Annotation(NamedTuple):
    """What GitHub shows beside a run; neither field is escaped yet."""

    level: _Level
    title: str
    message: str


def workflow_commands(report: FullReport, file: str) -> list[str]:
    """Returns the commands that annotate the run, at most as many as GitHub shows.

    Args:
        report: The run.
        file: The document, as its path in the repository; empty for none.
    """
    found = list(_annotations(report))
    return [
        workflow_command(each, file)
        for level in ("error", "warning")
        for each in _limited([each for each in found if each.level == level])
    ]


def workflow_command(annotation: Annotation, file: str = "") -> str:
    """Returns the command that makes an annotation; nothing in its text ends it or begins another.

    See GitHub's documentation, "Workflow commands": ``%``, ends of lines and, in properties, ``:`` and ``,`` are
    escaped.
    """
    place = f"file={_property(file)},line=1," if file else ""
    title = _property(_cut(annotation.title))
    return f"::{annotation.level} {place}title={title}::{_data(_cut(annotation.message))}"


def _annotations(report: FullReport) -> Iterator[Annotation]:
    name = report.document
    if failure := report.failure:
        said = "; ".join([failure.reason, *map(str, failure.faults)])
        yield Annotation("error", f"{name}: {failure.stage or failure.code}", said)
    for rule in report.gate.rules if report.gate else ():
        if rule.verdict != "PASS":
            yield Annotation("error" if rule.verdict == "FAIL" else "warning", f"{name}: {rule.title}", rule.sentence)
    for stage in report.stages:
        if stage.name == "deployment" and stage.status in _FAILED:
            yield Annotation("error", f"{name}: deployment {stage.status}", stage.summary)
        if "alarm" in stage.facts:
            yield Annotation("warning", f"{name}: {stage.name}", str(stage.facts["alarm"]))
    for problem in report.problems:
        yield Annotation("warning", f"{name}: report", problem)
    yield from _group_annotations(report)


def _group_annotations(report: FullReport) -> Iterator[Annotation]:
    """Yields a warning for each group that is not as it should be, the worst first."""
    worlds = report.batch.worlds if report.batch else ()
    bad = [(world, group) for world in worlds for group in world.groups if group.state in {"failed", "error"}]
    for world, group in sorted(bad, key=lambda each: each[1].rate or 0.0):
        reasons = ", ".join(f"{each.episodes} x {each.reason}" for each in group.reasons)
        replay = "".join(f"; {example.replay}" for example in group.examples[:1])
        counts = f"{group.passed} of {group.episodes} episodes passed"
        yield Annotation("warning", f"{world.label}: {group.name}", f"{counts}: {reasons}{replay}")


def _limited(found: Sequence[Annotation]) -> list[Annotation]:
    if len(found) <= MOST_OF_A_KIND:
        return list(found)
    shown = found[: MOST_OF_A_KIND - 1]
    more = f"{len(found) - len(shown)} more; the summary of this step lists them"
    return [*shown, Annotation(found[0].level, "and more", more)]


def _cut(text: str) -> str:
    line = terminal_line(text)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(terminal_line(text)).replace(":", "%3A").replace(",", "%2C")
