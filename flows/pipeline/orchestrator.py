"""What runs the steps of a stage, and shows what came of them: this process alone, or Prefect.

A stage is a plain function. It asks the orchestrator of its context for what differs: under Prefect a step is a task
run, a page shows artifacts, and a button cancels. A process alone calls the step and shows nothing; records and files
in the store are the same.
"""

import logging
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from functools import reduce
from typing import ParamSpec, TypeVar

from flows.batch.batch_end import WrittenReport, write_report
from flows.batch.search_batch import SearchWorkers
from flows.batch.trend_history import write_trend_of_run
from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import MadeAsset, with_alarm
from specs.data.run_report import Artefact, PipelineReport, StageReport
from specs.errors import DocumentError
from specs.field_types import OutputLocation
from specs.settings import WORKERS, Workers, chosen_workers
from tasks.export.job.export_job import ExportWorkers
from tasks.progress.listener import Progress, stage_progress
from tasks.progress.log_lines import log_duration, log_in_chosen_format
from tasks.results.trend.trend_view import Alarm
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.metrics import BatchMetrics
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.worlds.job.generation_job import RemoteWorldMaker

P = ParamSpec("P")
R = TypeVar("R")
Reports = tuple[StageReport, ...]
logger = logging.getLogger(__name__)


class Orchestrator:
    """What a stage asks for, as this process alone gives it: no pages, no artifacts, no events, no cluster.

    `flows.prefect.prefect_orchestrator` has the one that tells Prefect.
    """

    @property
    def flow_run_id(self) -> str:
        """The flow run that this is in; empty if there is none."""
        return ""

    def as_run(self, step: Callable[P, R]) -> Callable[P, R]:
        """Returns what runs a step, or a stage of a pipeline; its arguments are data that can be sent."""
        return step

    def is_cancelling(self, flow_run_id: str) -> bool:  # noqa: ARG002 - of Prefect's
        """Returns whether somebody cancels a flow run; `simyard cancel` reaches this process through the store."""
        return False

    def watch_cancellation(self) -> AbstractContextManager[Callable[[], bool]]:
        """Yields what says whether somebody cancels the flow run that this is in; it may be called every second."""
        return nullcontext(lambda: self.is_cancelling(self.flow_run_id))

    def end_flow_run_before(self, run: JobRecord) -> None:
        """Ends the flow run of the dead process that worked on a run before, as the run's record says."""

    def show_waiting(self, sentence: str) -> None:
        """Shows that this process waits for another one, which the sentence names; the terminal has a bar for it."""

    def requeue_run(self, sentence: str, run: JobRecord) -> None:
        """Ends this process, to be begun again later, where it keeps others from a place while it waits for a run."""

    def awaited_run(self) -> str:
        """Returns the id of the run that this flow run waited for when it was requeued; empty if it was not."""
        return ""

    def show_work(self) -> None:
        """Shows that this process waits no longer, and works."""

    def tag_run(self, run: JobRecord) -> AbstractContextManager[None]:  # noqa: ARG002 - of Prefect's
        """Marks what happens in the block as a part of a run."""
        return nullcontext()

    def announce_changes(self) -> AbstractContextManager[None]:
        """Tells of each change of a job's status in the block: in the log, if SIMYARD_LOG_FORMAT asks for it."""
        return log_in_chosen_format()

    def announce_verdict(self, answer: GateAnswer, run: JobRecord, batch: JobRecord) -> None:
        """Tells of a gate's verdict, once the run's record has it."""

    def announce_alarm(self, alarm: Alarm, url: str) -> None:
        """Tells of a change of a document's rate, as the run's report does; the page of its nights is at the URL."""

    def announce_asset(self, made: MadeAsset) -> None:
        """Tells of something that was made; of the same one as often as a run is continued."""

    def progress(self, stage: str, key: str) -> AbstractContextManager[Progress]:  # noqa: ARG002 - of Prefect's
        """Yields a function that tells how far a stage is: the terminal, and a page under the key."""
        return nullcontext(stage_progress(stage))

    def show_metrics(self, batch: JobRecord) -> None:
        """Shows how fast a batch was."""

    def show_batch_report(self, report: WrittenReport) -> None:
        """Shows a batch's report in short."""

    def show_run_report(self, report: PipelineReport) -> None:
        """Shows what each stage of a run came to."""

    def wanted_workers(self) -> Workers | None:
        """Returns the workers of a cluster that shall do the work; None where this process does it.

        Raises:
            DocumentError: SIMYARD_WORKERS asks for workers that there are not; only Prefect reaches any.
        """
        if chosen_workers() is None:
            return None
        allowed = "nothing, where no Prefect server hands out the work: unset it, or leave --direct out"
        raise DocumentError.of(WORKERS, "set", allowed)

    def world_makers(self, store: Store) -> RemoteWorldMaker | None:  # noqa: ARG002 - of Prefect's
        """Returns what hands worlds to workers; None where this process makes them."""
        self.wanted_workers()

    def world_writers(self, store: Store) -> ExportWorkers | None:  # noqa: ARG002 - of Prefect's
        """Returns what hands exported worlds to workers; None where this process writes them."""
        self.wanted_workers()

    def search_workers(self) -> SearchWorkers | None:
        """Returns what has a search's episodes driven on workers; None where this process drives them."""
        self.wanted_workers()

    def spread_batch(self, batch: OpenBatch, location: OutputLocation, workers: Workers) -> BatchMetrics | None:
        """Commits the chunks of a batch on workers; returns its speed. A process alone has none."""
        raise NotImplementedError


_orchestrator: ContextVar[Orchestrator | None] = ContextVar("simyard_orchestrator", default=None)
_ALONE = Orchestrator()


def orchestrator() -> Orchestrator:
    """Returns the orchestrator of this context: the process alone, unless a flow has chosen Prefect."""
    return _orchestrator.get() or _ALONE


def run_step(step: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Returns what a step returns that the orchestrator of this context runs; the log says how long it took."""
    with log_duration(step.__name__):
        return orchestrator().as_run(step)(*args, **kwargs)


@contextmanager
def orchestrated_by(chosen: Orchestrator) -> Generator[None, None, None]:
    """Makes an orchestrator that of the ``with`` block."""
    token = _orchestrator.set(chosen)
    try:
        yield
    finally:
        _orchestrator.reset(token)


def try_to_show(stages: Reports, show: Callable[[], Reports]) -> Reports:
    """Returns the reports that showing them returns; if it fails, with an alarm that says so.

    The verdict and its evidence are in the store before anything is shown, and whether a version is rolled out follows
    from them alone. What fails here must neither pass for the deployment's failure nor hide it, nor leave the run open
    whose robots have a new version.
    """
    try:
        return show()
    except Exception as exc:
        logger.exception("what came of a run could not be shown")
        why = " ".join(f"{type(exc).__name__}: {exc}".split())
        return tuple(with_alarm(stage, f"What came of it could not be shown: {why}") for stage in stages)


def show_trend(simulated: Reports, store: Store, run: JobRecord, batch: JobRecord) -> Reports:
    """Returns the batch's report, the trend of the document being written; with an alarm for each rate that fell."""
    written = write_trend_of_run(store, run, batch)
    if written is None:
        return simulated
    for alarm in written.alarms:
        orchestrator().announce_alarm(alarm, written.url)
    falls = [f"{alarm.sentence} See {written.url}" for alarm in written.alarms if alarm.fell]
    page = Artefact(label="trend", url=written.url)
    return tuple(
        reduce(with_alarm, falls, stage.model_copy(update={"artefacts": (*stage.artefacts, page)}))
        for stage in simulated
    )


def show_verdict(judged: Reports, store: Store, batch: JobRecord) -> Reports:
    """Returns the gate's report, the batch's page being written; with an alarm where it could not be."""
    written = write_report(store, batch)
    if isinstance(written, WrittenReport):
        orchestrator().show_batch_report(written)
        return judged
    return tuple(with_alarm(stage, written.alarm()) for stage in judged)
