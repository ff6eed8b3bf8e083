"""What `simyard run` tells CI, however the run ends: files, one JSON document, annotations."""

import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import NamedTuple

from flows.ci.run_files import (
    AskedRun,
    annotated_problem,
    annotations,
    append_summary,
    github_step,
    prepare_junit,
    unheard_commands,
    write_junit,
)
from flows.cli.exit_codes import exit_code_of
from flows.cli.output import echo, echo_commands, echo_json
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, SimyardError
from tasks.results.ci.full_report import FullReport


class CiWishes(NamedTuple):
    """What a run is to leave for CI.

    Attributes:
        file: The document.
        asked: Its name, and where the store is.
        junit: The JUnit file; None for none.
        as_json: Whether stdout gets one JSON document and nothing else.
    """

    file: Path
    asked: AskedRun
    junit: Path | None
    as_json: bool


def run_for_ci(wishes: CiWishes, run: Callable[[], PipelineReport]) -> PipelineReport:
    """Returns the report of a run, having told CI of it; raises what the run raises, having told CI of that, too.

    Args:
        wishes: What is to be left.
        run: Runs the document.
    """
    step = github_step()
    _prepare(wishes)
    # What libraries print must not end up in the JSON document, nor reach the runner after it obeys again, as it may
    # from another stream.
    aside = redirect_stdout(sys.stderr) if wishes.as_json or step.annotated else nullcontext()
    try:
        with unheard_commands(step, echo_commands), aside:
            report = run()
    except Exception as exc:
        try:
            _tell(wishes, exc)
        except SimyardError as problem:  # the command ends with what came of the run
            echo(problem, err=True)
        raise
    _tell(wishes, report)
    return report


def _prepare(wishes: CiWishes) -> None:
    if wishes.junit is None:
        return
    try:
        prepare_junit(wishes.junit, wishes.asked)
    except DocumentError as exc:
        _tell(wishes._replace(junit=None), exc)
        raise


def _tell(wishes: CiWishes, end: PipelineReport | Exception) -> None:
    """Tells CI of a run that came to an end, by its report or by what it raised."""
    step = github_step()
    if not (wishes.junit or wishes.as_json or step.summary or step.annotated):
        return
    report = _found(wishes.asked, end)
    if wishes.as_json:
        echo_json(report.model_dump_json(indent=2))
    if step.annotated:
        for line in annotations(report, wishes.file):
            echo_commands(line)
    try:
        append_summary(step, report)
    except SimyardError as exc:  # nobody asked this command for it, so the answer stays what it is
        echo_commands(annotated_problem(exc)) if step.annotated else echo(exc, err=True)
    if wishes.junit:
        write_asked_junit(wishes.junit, report)


def _found(asked: AskedRun, end: PipelineReport | Exception) -> FullReport:
    from flows.ci.run_report import report_of_failure, report_of_run  # noqa: PLC0415 - a run without CI needs no tables

    if isinstance(end, PipelineReport):
        return report_of_run(asked, end, 0)
    return report_of_failure(asked, end, exit_code_of(end))


def write_asked_junit(path: Path, report: FullReport) -> None:
    """Writes the JUnit file that a command was asked for.

    Raises:
        SimyardError: It cannot be written.
    """
    try:
        write_junit(path, report)
    except OSError as exc:
        raise SimyardError(f"--junit {path} cannot be written: {exc.strerror}") from exc
