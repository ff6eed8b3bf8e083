"""The stage that drives a robot application through worlds, seeds and parameters."""

import logging
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from threading import Thread

from pydantic import JsonValue

from flows.batch.batch_end import end_batch
from flows.batch.batch_report import WrittenReport
from flows.batch.batch_steps import EPISODES, audit_batch, simulate_chunk, unusable_bundle, write_tables
from flows.batch.early_end import EarlyEnd
from flows.document.references import numbered_finder
from flows.document.tested_batch import batch_plan
from flows.stage.orchestrator import orchestrator, run_step
from flows.stage.stage_run import require_success, run_stage
from specs.digest import canonical_document
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate
from specs.pipeline.section_requests import simulation_request
from specs.pipeline.simulation_section import SimulationBatch
from specs.settings import Workers
from tasks.applications.bundle_failure import BUNDLE_ERRORS
from tasks.applications.step import unpack_application
from tasks.simulate.batch.chunk_store import chunk_numbers, spent_s
from tasks.simulate.batch.job import (
    GOING,
    KIND,
    OpenBatch,
    close_refused,
    complete,
    load_batch,
    open_batch,
    require_plan,
    time_out,
)
from tasks.simulate.batch.metrics import METRICS, BatchMeter, BatchMetrics
from tasks.simulate.batch.prepared_chunks import chunks_ahead, forget_chunks
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.chunk.timings import collect_timings
from tasks.simulate.forecast.batch_watch import BatchWatch
from tasks.simulate.plan.resolve import output_location
from tasks.simulate.process.simulators import prepare_simulator
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.store_url import open_store, store_id

# PyArrow looks for pandas when it makes its first column; reports work out intervals.
_NEEDED_AT_THE_END = ("pandas", "scipy.optimize")
logger = logging.getLogger(__name__)


def simulation_batch(
    spec: SimulationBatch,
    worlds: list[str] | None = None,
    store: str | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    gate: Gate | None = None,
) -> JobRecord:
    """Returns the batch; see the flow `flows.simulation_batch.simulation_batch`."""
    orchestrator().wanted_workers()  # refuses workers that are not installed, before anything is recorded
    at = open_store(store)
    plan = batch_plan(spec, worlds or [], at, numbered_finder(at, versions), gate)
    location = output_location(spec)

    def work(given: str) -> JobRecord:
        request = simulation_request(spec, store_id=store_id(at), token=given)
        record = open_batch(at, plan, canonical_document(request), request.clientRequestToken or given)
        require_plan(at, record.id, plan)
        if is_terminal(record):
            return require_success(record)
        return require_success(run_batch(at, record.id, location, gate))

    identity = {"spec": canonical_document(spec), "plan": plan.model_dump(mode="json")}
    return run_stage(at, "simulation-batch", identity, token, work)


def begin_simulation_process(store: Store, digests: Sequence[str]) -> None:
    """Begins the process that simulates before there is anything to simulate: it imports JAX while worlds are made.

    Returns at once. What hinders it hinders the stage as well, which says so.

    Args:
        store: Where the bundles are.
        digests: Of all applications of the batch.
    """
    Thread(target=_begin_process, args=(store, digests), name="simyard simulation process", daemon=True).start()


def _begin_process(store: Store, digests: Sequence[str]) -> None:
    try:
        prepare_simulator({digest: unpack_application(store.url, digest) for digest in digests})
    except (SimyardError, OSError) as exc:
        logger.debug("no process simulates before it is asked: %s", exc)


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
            if not _workers(work) and _simulates(work):
                _begin_process(store, work.plan.digests())  # which imports JAX while the first chunk is made ready
            _unpack_bundles(work)
            watch = BatchWatch()
            early = _simulate(work, location, gate)
            watch.drove()
            with collect_timings() as audited:
                end = _close(work, location, early)
        except (DocumentError, StageFailed) as exc:
            close_refused(work, exc)
            raise
        watch.keep(work, end, audited)
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


def _simulate(batch: OpenBatch, location: OutputLocation, gate: Gate | None) -> dict[str, JsonValue]:
    """Commits all chunks, or those before the batch is cancelled or its time is over.

    Returns the batch's speed, and why it ended early, if it did.
    """
    workers = _workers(batch)
    if workers:
        return _metric_fields(orchestrator().spread_batch(batch, location, workers))
    early, meter = EarlyEnd(batch, gate), BatchMeter()
    note_machine(batch)
    _import_ahead()
    try:
        _simulate_here(batch, location, early, meter)
    finally:
        forget_chunks(batch)
    return {**early.detail, **_metric_fields(meter.metrics())}


def _simulates(batch: OpenBatch) -> bool:
    """Returns whether episodes are left to simulate, or to audit."""
    return bool(batch.plan.audit) or len(chunk_numbers(batch.store, batch.id).committed) < batch.layout.chunks


def _workers(batch: OpenBatch) -> Workers | None:
    """Returns who simulates; None for this machine. An early end is decided chunk by chunk, in order."""
    return None if batch.plan.shuffled else orchestrator().wanted_workers()


def _import_ahead() -> None:
    """Imports what the batch's end needs while its episodes are driven in another process; returns at once."""

    def begin() -> None:
        for module in _NEEDED_AT_THE_END:
            with suppress(ImportError):  # whoever needs it says so
                import_module(module)

    Thread(target=begin, name="simyard imports", daemon=True).start()


def _simulate_here(batch: OpenBatch, location: OutputLocation, early: EarlyEnd, meter: BatchMeter) -> None:
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


def _close(batch: OpenBatch, location: OutputLocation, more: dict[str, JsonValue]) -> JobRecord:
    """Returns the batch in its terminal state, with its tables, audit and report."""
    record = complete(batch)
    if is_terminal(record):
        return record

    def tables(of: OpenBatch, place: OutputLocation, status: str) -> dict[str, JsonValue]:
        return run_step(write_tables, of.store.url, of.id, status, place).detail

    def audit() -> dict[str, JsonValue]:
        return run_step(audit_batch, batch.store.url, batch.id, location) if batch.plan.audit else {}

    end = end_batch(batch, record, location, write_tables=tables, audit=audit, more=more)
    orchestrator().show_metrics(end.record)
    if isinstance(end.report, WrittenReport):
        orchestrator().show_batch_report(end.report)
    return end.record


def _metric_fields(metrics: BatchMetrics | None) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its speed; nothing if nothing was simulated."""
    return {METRICS: metrics.model_dump(mode="json")} if metrics else {}
