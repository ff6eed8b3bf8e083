"""Drives a batch to its end: chunk after chunk here or on workers, then its tables, audit and report.

A batch that was killed is continued: chunks that are committed are not simulated again.
"""

import logging
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from importlib import import_module
from threading import Thread

from pydantic import JsonValue

from flows.batch.batch_end import WrittenReport, end_batch
from flows.batch.batch_steps import EPISODES, SequentialStop, audit_batch, simulate_chunk, unusable_bundle, write_tables
from flows.pipeline.orchestrator import orchestrator, run_step
from flows.pipeline.references import ParsedRun
from specs.errors import DocumentError, ResourceNotFound, SimyardError, StageFailed
from specs.field_types import OutputLocation
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from specs.settings import Workers
from tasks.applications.registry import BUNDLE_ERRORS
from tasks.applications.step import unpack_application
from tasks.deploy.step import robot_reserve
from tasks.progress.listener import current_listener, listen_to_progress, report_progress
from tasks.simulate.batch.batch_record import GOING, KIND, OpenBatch, close_refused, complete, load_batch, time_out
from tasks.simulate.batch.chunk_run import chunks_ahead, forget_chunks
from tasks.simulate.batch.chunk_store import chunk_numbers, spent_s
from tasks.simulate.batch.metrics import METRICS, BatchMeter, BatchMetrics
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.chunk.byproducts import collect_timings
from tasks.simulate.forecast.batch_times import BatchWatch
from tasks.simulate.sandbox.process_pool import prepare_simulator
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, is_terminal, job_id, read
from tasks.storage.jobs.runs import stage_token

# PyArrow looks for pandas when it makes its first column; reports work out intervals.
_NEEDED_AT_THE_END = ("pandas", "scipy.optimize")
logger = logging.getLogger(__name__)


def prepare_simulation(work: ParsedRun) -> None:
    """Begins the process that simulates, if the run is going to simulate here after other stages; returns at once."""
    before = work.spec.worldGeneration or work.spec.worldExport
    if work.found.batch and before and not orchestrator().wanted_workers() and ended_batch(work) is None:
        begin_simulation_process(work.store, work.found.batch.first_bundles())


def begin_simulation_process(store: Store, digests: Sequence[str]) -> None:
    """Begins the process that simulates before there is anything to simulate: it imports JAX while worlds are made.

    Returns at once. What hinders it hinders the stage as well, which says so.

    Args:
        store: Where the bundles are.
        digests: Of the applications that its first episodes run.
    """
    Thread(target=_begin_process, args=(store, digests), name="simyard simulation process", daemon=True).start()


def _begin_process(store: Store, digests: Sequence[str]) -> None:
    try:
        prepare_simulator({digest: unpack_application(store.url, digest) for digest in digests})
    except (SimyardError, OSError) as exc:
        logger.debug("no process simulates before it is asked: %s", exc)


def ended_batch(work: ParsedRun) -> JobRecord | None:
    """Returns the batch of a run that goes on after it, or None."""
    try:
        record = read(work.store, KIND, job_id(KIND, stage_token(work.run, "batch")))
    except ResourceNotFound:
        return None
    return record if record.status == "Completed" else None


@contextmanager
def robots_in_reserve(spec: PipelineSpec, store: Store) -> Generator[Callable[[], None], None, None]:
    """Yields what begins a demonstration's agents: it is called when the batch's last episode ends, or by the block.

    They import what they need while the batch is audited and judged. The roll-out alone tells them what to do, which
    there is only after the gate has passed.

    Args:
        spec: The document.
        store: The run's store.
    """
    section, listener = spec.deployment, current_listener()
    with robot_reserve(store, section) if section else nullcontext(lambda: None) as begin:

        def hear(stage: str, done: int, total: int) -> None:
            listener(stage, done, total)
            if stage == EPISODES and done >= total:
                begin()

        with listen_to_progress(hear):
            yield begin


_CLOSING = "Audit and tables"


def run_batch(store: Store, batch: str, location: OutputLocation, gate: Gate | None = None) -> JobRecord:
    """Returns the record of a batch that was opened, in its terminal state; one that was killed is continued.

    Args:
        store: Where it is.
        batch: Its id.
        location: Where its tables go.
        gate: What may end it early.
    """
    with hold_claim(store, claim_key(KIND, batch)):
        work = load_batch(store, batch)
        record = work.record()
        if is_terminal(record):  # a cancellation closed it while this process waited for the claim
            return record
        try:
            if not _batch_workers(work) and (
                bool(work.plan.audit) or len(chunk_numbers(work.store, work.id).committed) < work.layout.chunks
            ):
                _begin_process(
                    store, work.plan.first_bundles()
                )  # which imports JAX while the first chunk is made ready
            _unpack_bundles(work)
            watch = BatchWatch()
            with collect_timings() as driven:
                more, audit = _simulate_chunks(work, location, gate)
            watch.drove()
            with collect_timings() as audited:
                report_progress(_CLOSING, 0, 1)
                end = _close_batch(work, location, more, audit)
                report_progress(_CLOSING, 1, 1)
        except (DocumentError, StageFailed) as exc:
            close_refused(work, exc)
            raise
        watch.keep(work, end, driven, audited)
        return end


def _unpack_bundles(batch: OpenBatch) -> None:
    """Unpacks the batch's applications before the first chunk; of one that cannot be had, the log says why.

    Jobs that need it fail, each with that reason in its row, and the others run.
    """
    for digest, name in batch.plan.bundles().items():
        try:
            run_step(unpack_application, batch.store.url, digest, name)
        except BUNDLE_ERRORS as exc:
            logger.warning("%s: jobs will fail: %s", batch.id, unusable_bundle(batch, digest, exc))


def _simulate_chunks(
    batch: OpenBatch, location: OutputLocation, gate: Gate | None
) -> tuple[dict[str, JsonValue], dict[str, JsonValue]]:
    """Commits all chunks, or those before the batch is cancelled or its time is over.

    Returns the batch's speed, and why it ended early, if it did; and its audit, where that let it end.
    """
    workers = _batch_workers(batch)
    if workers:
        return _metric_fields(orchestrator().spread_batch(batch, location, workers)), {}

    def audited(chunks: int) -> dict[str, JsonValue]:
        return run_step(audit_batch, batch.store.url, batch.id, location, chunks)

    early, meter = SequentialStop(batch, gate, audited), BatchMeter()
    note_machine(batch)
    _import_ahead()
    try:
        _simulate_here(batch, location, early, meter)
    finally:
        forget_chunks(batch)
    return {**early.detail, **_metric_fields(meter.metrics())}, early.audit


def _batch_workers(batch: OpenBatch) -> Workers | None:
    """Returns who simulates; None for this machine. An early end is decided chunk by chunk, in order."""
    return None if batch.plan.shuffled else orchestrator().wanted_workers()


def _import_ahead() -> None:
    """Imports what the batch's end needs while its episodes are driven in another process; returns at once."""

    def begin() -> None:
        for module in _NEEDED_AT_THE_END:
            with suppress(ImportError):  # whoever needs it says so
                import_module(module)

    Thread(target=begin, name="simyard imports", daemon=True).start()


def _simulate_here(batch: OpenBatch, location: OutputLocation, early: SequentialStop, meter: BatchMeter) -> None:
    """Commits the chunks one after the other in this process."""
    layout, before_s, start_s = batch.layout, spent_s(batch.store, batch.id), time.monotonic()
    lanes, done = batch.plan.lanes, 0
    committed = chunk_numbers(batch.store, batch.id).committed
    with orchestrator().progress(EPISODES, "episodes-progress") as progress:
        for number in range(layout.chunks):
            worked_s = before_s + time.monotonic() - start_s
            left_s = batch.plan.timeout_s - worked_s
            now = time_out(batch) if left_s <= 0 else batch.record()
            if now.status not in GOING:
                return
            if early.ends_before(number):
                break
            progress(done, layout.episodes)
            ended = run_step(
                simulate_chunk,
                batch.store.url,
                batch.id,
                number,
                location=location,
                lanes=lanes,
                left_s=left_s,
                spent_s=worked_s,
                done=done,
                ahead=chunks_ahead([each for each in range(number + 1, layout.chunks) if each not in committed]),
            )
            lanes, done = ended.lanes, done + ended.episodes
            meter.add(ended.work, "")
        progress(layout.episodes, layout.episodes)


def _close_batch(
    batch: OpenBatch, location: OutputLocation, more: dict[str, JsonValue], audited: dict[str, JsonValue]
) -> JobRecord:
    """Returns the batch in its terminal state, with its tables, audit and report.

    Args:
        batch: All that it drives is committed.
        location: Where its tables go.
        more: What its record says besides.
        audited: What it says of its audit, where that was made already; else empty.
    """
    record = complete(batch)
    if is_terminal(record):
        return record

    def audit() -> dict[str, JsonValue]:
        if audited or not batch.plan.audit:
            return audited
        return run_step(audit_batch, batch.store.url, batch.id, location)

    tables = run_step(write_tables, batch.store.url, batch.id, record.status, location).detail
    end = end_batch(batch, record, location, {**tables, **more}, audit)
    orchestrator().show_metrics(end.record)
    if isinstance(end.report, WrittenReport):
        orchestrator().show_batch_report(end.report)
    return end.record


def _metric_fields(metrics: BatchMetrics | None) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its speed; nothing if nothing was simulated."""
    return {METRICS: metrics.model_dump(mode="json")} if metrics else {}
