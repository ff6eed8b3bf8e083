"""`simyard run`: runs the pipeline with progress bars, under a Prefect server or without one, and tells CI how it ends.

With Prefect it finds or starts a server, which starts while Prefect, and what the document needs, are imported, so much
of its start costs no time. With `--direct` the same stages run as plain functions. What needs a server is lost then:
pages, artifacts, events, automations, workers of a cluster, and Prefect's cancellation. The store has the same records
and files, so that either way continues what the other began.
"""

import logging
import os
import secrets
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from flows.cli.terminal import echo, echo_commands, echo_json, exit_code_of
from flows.pipeline.pipeline import pipeline
from flows.pipeline.references import new_bucket_lines, resolve_references
from flows.pipeline.version_retention import version_lines
from flows.pipeline.world_imports import sources_read_once
from flows.prefect.prefect_server import ServerChoice, prefect_server
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.untrusted_text import terminal_text
from tasks.progress.listener import Listener, listen_to_progress
from tasks.results.ci.full_report import FullReport, RunFailure
from tasks.results.ci.github import SUMMARY_BYTES, Annotation, summary_markdown, workflow_command, workflow_commands
from tasks.results.ci.junit import junit_xml
from tasks.server.health import is_listening, url_without_password
from tasks.server.watchdog import WatchdogPace, WatchdogState, guard_run, pause_collector
from tasks.simulate.devices import prepare_devices
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.store_url import open_store

_LINE_EVERY_S = 10.0


@contextmanager
def progress_bars(console: Console) -> Generator[Listener, None, None]:
    """Yields what shows how far each stage is on the console, until the block ends."""
    if not console.is_terminal:
        yield ProgressLines(console).listen
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<20}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        bars: dict[str, TaskID] = {}

        def listen(stage: str, done: int, total: int) -> None:
            if stage not in bars:
                bars[stage] = progress.add_task(stage, total=total)
            progress.update(bars[stage], completed=done, total=total)

        yield listen


class ProgressLines:
    """A line when a stage begins, at its end, and now and then between: what is written stays."""

    def __init__(self, console: Console, now_s: Callable[[], float] = time.monotonic) -> None:
        """Begins to count the time.

        Args:
            console: Where lines are printed.
            now_s: The time.
        """
        self._console, self._now_s = console, now_s
        self._begin_s = now_s()
        self._told: dict[str, tuple[int, int]] = {}
        self._told_s: dict[str, float] = {}

    def listen(self, stage: str, done: int, total: int) -> None:
        """Prints how far a stage is, if that is new."""
        now_s, before = self._now_s(), self._told.get(stage)
        if before == (done, total):
            return
        if before is not None and done < total and now_s - self._told_s[stage] < _LINE_EVERY_S:
            return
        self._told[stage], self._told_s[stage] = (done, total), now_s
        line = f"{now_s - self._begin_s:6.1f} s  {stage} {done:,}/{total:,}"
        self._console.print(line, markup=False, highlight=False)


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
        raise DocumentError.of(
            "--junit", str(path), f"a file that can be written: {exc.strerror}", source="simyard"
        ) from exc


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


@contextmanager
def tell_ci(wishes: CiWishes) -> Generator[Callable[[PipelineReport], None], None, None]:
    """Tells CI of the run in the block, after it: of the report that what is yielded gets, or of what is raised.

    Args:
        wishes: What is to be left.
    """
    step, reports = github_step(), list[PipelineReport]()
    _prepare(wishes)
    # What libraries print must not end up in the JSON document, nor reach the runner after it obeys again, as it may
    # from another stream.
    aside = redirect_stdout(sys.stderr) if wishes.as_json or step.annotated else nullcontext()
    try:
        with unheard_commands(step, echo_commands), aside:
            yield reports.append
    except Exception as exc:
        try:
            _tell(wishes, exc)
        except SimyardError as problem:  # the command ends with what came of the run
            echo(problem, err=True)
        raise
    for report in reports:
        _tell(wishes, report)


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
    from flows.cli.ci_report import report_of_failure, report_of_run  # noqa: PLC0415 - a run without CI needs no tables

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


def run_directly(spec: PipelineSpec, base: Path, store_url: str | None, console: Console) -> PipelineReport:
    """Returns the report of the document's run without Prefect; takes and raises what ``run_document`` does."""
    for line in new_bucket_lines(spec, open_store(store_url)):
        console.print(line, markup=False, highlight=False)
    prepare_devices()
    with progress_bars(console) as listener, listen_to_progress(listener):
        return pipeline(spec, store_url, str(base))


_RESULT_BLOCK = "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK"
_NO_BLOCK = "Unable to find block document"  # as Prefect 3.8 says it, by a ValueError
# What Prefect imports when the first flow and the first task begin, which the user waits for.
_LATE_IMPORTS = ("prefect.flow_engine", "prefect.task_engine", "prefect.utilities.visualization", "fastapi")
logger = logging.getLogger(__name__)


@sources_read_once()
def run_document(spec: PipelineSpec, base: Path, store_url: str | None, console: Console) -> PipelineReport:
    """Returns the report of the document's run; one that was killed before is continued.

    Args:
        spec: The document.
        base: Folder that the document's relative paths start from.
        store_url: None means SIMYARD_STORE, else ``.simyard`` in the working directory.
        console: Where progress is shown.

    Raises:
        SimyardError: The document, the store or a stage is at fault.
    """
    store = open_store(store_url)
    trial = OverlayStore(store)
    resolve_references(spec, trial, base)  # a document with faults is refused before a server starts
    for line in (*version_lines(spec, store, trial), *new_bucket_lines(spec, store)):
        console.print(line, markup=False, highlight=False)
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # the terminal shows progress instead
    with (
        prefect_server(lambda: _prepare_engine(spec)) as server,
        progress_bars(console) as listener,
        listen_to_progress(listener),
        _guard_server(server, console),
    ):
        from flows.prefect.flow_calls import canceled_as_failure  # noqa: PLC0415 - Prefect loads as the server starts
        from flows.prefect.flows import pipeline  # noqa: PLC0415 - same

        try:
            with canceled_as_failure():
                return pipeline(spec, store=store.url, base=str(base))
        except ValueError as exc:
            if _NO_BLOCK not in str(exc):
                raise
            raise _block_fault() from exc


def _block_fault() -> DocumentError:
    allowed = (
        "a block of this Prefect server, made with the command of docs/operate/operations.md, Results; or not set, as "
        "for a server that runs only as long as this command"
    )
    return DocumentError.of(_RESULT_BLOCK, repr(os.environ.get(_RESULT_BLOCK)), allowed)


@contextmanager
def _guard_server(server: ServerChoice, console: Console) -> Generator[WatchdogState, None, None]:
    """Ends the run with one message and exit code 3 when the server goes away during the block."""

    def leave(failure: StageFailed) -> None:
        # Prefect holds the main thread, which cannot end the progress bars; the store is never left half written.
        console.show_cursor()
        sys.stderr.write(f"\n{terminal_text(str(failure))}\n")
        sys.stderr.flush()
        os._exit(3)

    reason = (
        f"the Prefect server at {url_without_password(server.api_url)} went away; "
        "the same command continues this run if the document is unchanged"
    )
    # Whether it listens, not how soon it answers: on a busy machine a server that is there may be silent for long.
    pace = WatchdogPace(patience_s=server.wait_s)
    with guard_run(lambda: is_listening(server.api_url), reason, leave, pace) as watch:
        yield watch


def _prepare_engine(spec: PipelineSpec) -> None:
    """Imports Prefect, and what the document's sections compute with: seconds that pass while the server starts."""
    if spec.simulationBatch:
        prepare_devices()
    with pause_collector():
        for module in (*_computing_modules(spec), "flows.prefect.flows", *_LATE_IMPORTS):
            import_module(module)
        import_module("flows.prefect.flow_calls").leave_heartbeats()


def _computing_modules(spec: PipelineSpec) -> list[str]:
    """Returns what a run of the document imports that many others do not: SciPy and MuJoCo.

    JAX is none of it: only the process that simulates imports that, see
    ``flows.pipeline.batch_run.begin_simulation_process``.
    """
    modules: list[str] = []
    if spec.worldGeneration:
        modules.append("scipy.ndimage")
    if spec.worldExport and "mjcf" in spec.worldExport.formats:
        modules.append("tasks.export.format.mjcf")
    return modules
