"""Prefect as what runs the steps of a stage: task runs, sub-flow runs, artifacts, events, workers."""

import base64
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, ParamSpec, TypeVar, cast

from prefect import Flow, tags
from prefect.artifacts import create_image_artifact, create_markdown_artifact, create_table_artifact
from prefect.exceptions import MissingResult
from prefect.runtime import flow_run

from flows.batch.batch_end import WrittenReport
from flows.batch.search_batch import SearchWorkers
from flows.pipeline.orchestrator import Orchestrator, orchestrated_by
from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import MadeAsset
from flows.prefect import prefect_events, tasks
from flows.prefect.flow_runs import (
    awaited_run,
    canceled_state,
    end_flow_run_before,
    is_cancelling,
    label_process,
    requeue_run,
    show_waiting,
    show_work,
    tag_flow_run,
    watch_cancellation,
)
from flows.prefect.prefect_events import log_on_page
from flows.prefect.spread_work import search_workers, spread_batch, world_makers, world_writers
from flows.prefect.worker_cluster import wanted_workers
from specs import untrusted_text
from specs.data.run_report import PipelineReport
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from specs.settings import Workers
from specs.untrusted_text import table_rows
from tasks.export.job.export_job import ExportWorkers
from tasks.progress.listener import Progress, document_artifact_key, document_name, work_for_document
from tasks.results.report.report_page import report_markdown, report_picture
from tasks.results.trend.trend_view import Alarm
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.metrics import BatchMetrics, metric_rows, recorded_metrics
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.runs import document_of_run, run_of
from tasks.worlds.job.generation_job import RemoteWorldMaker

P = ParamSpec("P")
R = TypeVar("R")


class PrefectOrchestrator(Orchestrator):
    """Runs each step as the task of its name in `flows.prefect.tasks`, and each stage of a pipeline as its flow.

    Args:
        stages: The flow of each stage, for a flow that has stages.
    """

    def __init__(self, stages: Sequence[Flow[..., Any]] = ()) -> None:
        self._stages = {stage.fn.__name__: stage for stage in stages}

    @property
    def flow_run_id(self) -> str:
        """The flow run that this is in."""
        return str(flow_run.id or "")

    def as_run(self, step: Callable[P, R]) -> Callable[P, R]:
        """Returns the stage's flow, or the step's task."""
        name = step.__name__
        flow_or_task: Callable[P, R] = self._stages[name] if name in self._stages else getattr(tasks, name)

        def run(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return flow_or_task(*args, **kwargs)
            except MissingResult:
                # The server's answer to the last state of a stage was lost. Prefect then takes the state from the
                # server, where a stage has no result. What was done is found by its token.
                return step(*args, **kwargs)

        return run

    def is_cancelling(self, flow_run_id: str) -> bool:
        """Returns whether Prefect's server says that somebody cancels a flow run."""
        return is_cancelling(flow_run_id)

    def watch_cancellation(self) -> AbstractContextManager[Callable[[], bool]]:
        """Yields what says whether Prefect cancels the flow run: by an event at once, else within 10 s."""
        return watch_cancellation(self.flow_run_id)

    def end_flow_run_before(self, run: JobRecord) -> None:
        """Makes the flow run of the dead process Crashed."""
        end_flow_run_before(run, self.flow_run_id)

    def show_waiting(self, sentence: str) -> None:
        """Makes the flow run's state Running (Waiting)."""
        show_waiting(sentence)

    def requeue_run(self, sentence: str, run: JobRecord) -> None:
        """Schedules a deployment's flow run anew, and ends its process."""
        requeue_run(sentence, run.id)

    def awaited_run(self) -> str:
        """Returns what a label of the flow run says."""
        return awaited_run()

    def show_work(self) -> None:
        """Makes the flow run's state Running."""
        show_work()

    @contextmanager
    def tag_run(self, run: JobRecord) -> Generator[None, None, None]:
        """Tags this flow run, and those that begin in the block, so that pages find them by the run's id.

        The artifacts of the block have the document's name in their keys.
        """
        tag_flow_run(run.id)
        with tags(run.id), work_for_document(document_of_run(run)):
            yield

    def announce_changes(self) -> AbstractContextManager[None]:
        """Sends an event for each change of a job's status in the block."""
        return prefect_events.announce_changes()

    def announce_verdict(self, answer: GateAnswer, run: JobRecord, batch: JobRecord) -> None:
        """Sends the event of a gate's verdict."""
        prefect_events.announce_verdict(answer, run, batch)

    def announce_alarm(self, alarm: Alarm, url: str) -> None:
        """Sends the event of a change of a document's rate."""
        prefect_events.announce_alarm(alarm, url)

    def announce_asset(self, made: MadeAsset) -> None:
        """Sends Prefect's events of an asset."""
        prefect_events.announce_asset(made)

    def progress(self, stage: str, key: str) -> AbstractContextManager[Progress]:
        """Yields a function that tells the terminal and Prefect."""
        return tasks.show_progress(stage, key)

    def show_metrics(self, batch: JobRecord) -> None:
        """Leaves a batch's figures as the artifact ``batch-metrics``."""
        metrics = recorded_metrics(batch)
        if metrics:
            rows = table_rows(dict(row) for row in metric_rows(metrics))
            create_table_artifact(
                table=rows, key=document_artifact_key("batch-metrics"), description=f"Speed of {batch.id}"
            )

    def show_batch_report(self, report: WrittenReport) -> None:
        """Leaves a report, in short, as the artifacts ``batch-report`` and ``batch-picture``."""
        view, batch = report.view, report.view.facts.batch
        text, picture = report_markdown(view, report.url), base64.b64encode(report_picture(view)).decode()
        create_markdown_artifact(text, key=document_artifact_key("batch-report"), description=f"Report of {batch}")
        create_image_artifact(
            f"data:image/svg+xml;base64,{picture}",
            key=document_artifact_key("batch-picture"),
            description=f"Rate and failures of {batch}",
        )

    def show_run_report(self, report: PipelineReport) -> None:
        """Leaves what each stage came to as the artifact ``pipeline-report``."""
        rows = [
            {"stage": s.name, "status": s.status, "what came of it": s.summary, "seconds": round(s.seconds, 1)}
            for s in report.stages
        ]
        # This is after the block of the document's run, so that the key is made of the report's name.
        key = untrusted_text.artifact_key(report.name, "pipeline-report")
        create_table_artifact(table=table_rows(rows), key=key, description=f"{report.name}: {report.run}")

    def wanted_workers(self) -> Workers | None:
        """Returns what SIMYARD_WORKERS asks for."""
        return wanted_workers()

    def world_makers(self, store: Store) -> RemoteWorldMaker | None:
        """Returns what hands worlds to the workers that SIMYARD_WORKERS names."""
        return world_makers(store)

    def world_writers(self, store: Store) -> ExportWorkers | None:
        """Returns what hands exported worlds to the workers that SIMYARD_WORKERS names."""
        return world_writers(store)

    def search_workers(self) -> SearchWorkers | None:
        """Returns what has a search's episodes driven on the workers that SIMYARD_WORKERS names."""
        return search_workers()

    def spread_batch(self, batch: OpenBatch, location: OutputLocation, workers: Workers) -> BatchMetrics | None:
        """Commits the chunks of a batch on workers."""
        return spread_batch(batch, location, workers)


@contextmanager
def under_prefect(stages: Sequence[Flow[..., Any]] = (), *, is_queued: bool = False) -> Generator[None, None, None]:
    """Makes Prefect the orchestrator of the block, which is a flow's body.

    Args:
        stages: The flow of each stage, for a flow that has stages.
        is_queued: Whether the flow run is of a queued job.
    """
    label_process(is_queued=is_queued)
    with orchestrated_by(PrefectOrchestrator(stages)), log_on_page():
        yield


def flow_result(work: Callable[[], R], token: str | None = None) -> R:
    """Returns what a flow returns: what its work did, or the state of a flow run that was cancelled.

    Args:
        work: The stage.
        token: The pipeline's for it: then its failure is the pipeline's to explain.

    Raises:
        StageFailed: It failed, and was not cancelled.
    """
    try:
        return work()
    except StageFailed as exc:
        if token is not None:
            raise
        return cast("R", canceled_state(exc))  # which Prefect takes for the flow run's


def run_name() -> str:
    """Returns what Prefect's pages call a stage: ``nightly-batch`` in a document's run, its flow's name when alone."""
    token = flow_run.parameters.get("token")
    if not token:
        return str(flow_run.flow_name)
    run = run_of(token)
    return f"{document_name()}{token.removeprefix(run)}" if run and document_name() else str(token)
