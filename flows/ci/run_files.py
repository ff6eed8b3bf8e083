"""What a run leaves for CI: a JUnit file, one JSON document, and GitHub's summary and annotations."""

import os
import secrets
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from specs.base import Fault
from specs.errors import DocumentError, SimyardError
from tasks.results.ci.annotations import Annotation, workflow_command, workflow_commands
from tasks.results.ci.full_report import FullReport, RunFailure
from tasks.results.ci.junit import junit_xml
from tasks.results.ci.summary import SUMMARY_BYTES, summary_markdown

_GITHUB, _SUMMARY = "GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"
_NOT_ENDED = "the run has not ended: its process was stopped or killed before it could say what came of it"


class AskedRun(NamedTuple):
    """A run that is to be reported on: the name of its document, and where its store is."""

    document: str
    store_url: str


class GitHubStep(NamedTuple):
    """A step of GitHub Actions, as its variables describe it.

    Attributes:
        summary: The file of its summary; None if it has none.
        annotated: Whether it is a step of a real runner, which obeys what is printed.
    """

    summary: Path | None
    annotated: bool


def github_step(environment: Mapping[str, str] = os.environ) -> GitHubStep:
    """Returns the step of GitHub Actions that this process is a part of; an empty one elsewhere."""
    named = environment.get(_SUMMARY, "")
    return GitHubStep(Path(named) if named else None, environment.get(_GITHUB) == "true")


def prepare_junit(path: Path, asked: AskedRun) -> None:
    """Writes a file that says that the run has not ended, so that no older file is taken for this run's.

    Args:
        path: The file; its folder is made.
        asked: The run.

    Raises:
        DocumentError: It cannot be written.
    """
    failure = RunFailure(code="NotEnded", reason=_NOT_ENDED)
    begun = FullReport(answer="FAILED", exit_code=3, document=asked.document, store=asked.store_url, failure=failure)
    try:
        write_junit(path, begun)
    except OSError as exc:
        fault = Fault(path="--junit", value=str(path), allowed=f"a file that can be written: {exc.strerror}")
        raise DocumentError([fault], source="simyard") from exc


def write_junit(path: Path, report: FullReport) -> None:
    """Writes a run's JUnit file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.parent / f".{path.name}.{os.getpid()}.part"
    try:
        part.write_bytes(junit_xml(report))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def append_summary(step: GitHubStep, report: FullReport) -> None:
    """Appends a run's summary to that of a step, as much as GitHub still takes.

    Raises:
        SimyardError: The file cannot be written.
    """
    if step.summary is None:
        return
    try:
        before = step.summary.stat().st_size if step.summary.exists() else 0
        with step.summary.open("a", encoding="utf-8") as file:
            file.write(summary_markdown(report, SUMMARY_BYTES - before))
    except OSError as exc:
        raise SimyardError(f"{_SUMMARY}={step.summary} cannot be written: {exc.strerror}") from exc


def annotations(report: FullReport, file: Path) -> list[str]:
    """Returns the workflow commands that annotate a run.

    Args:
        report: The run.
        file: The document; named in annotations if it is in the checkout.
    """
    path, checkout = file.resolve(), Path(os.environ.get("GITHUB_WORKSPACE") or Path.cwd()).resolve()
    return workflow_commands(report, path.relative_to(checkout).as_posix() if path.is_relative_to(checkout) else "")


def annotated_problem(problem: Exception) -> str:
    """Returns the workflow command that shows why there is no summary."""
    return workflow_command(Annotation("warning", "simyard", str(problem)))


@contextmanager
def unheard_commands(step: GitHubStep, say: Callable[[str], None]) -> Generator[None, None, None]:
    """Keeps the runner from obeying what is printed inside the block, by GitHub's own command ``stop-commands``.

    What applications, worlds and libraries say is printed there, and a line that begins with two colons is an order to
    the runner: to hide a word, to set an output. The word that ends it is drawn at random, so that nobody else knows
    it.
    """
    if not step.annotated:
        yield
        return
    word = secrets.token_hex(16)
    say(f"::stop-commands::{word}")
    try:
        yield
    finally:
        say(f"::{word}::")
