"""The flow `simulation-batch`: drives a robot application through worlds, seeds and parameters."""

import time
from functools import partial
from pathlib import Path

from prefect import flow
from pydantic import JsonValue

from flows.batch.batch_artifacts import metric_fields, show_batch_report, show_metrics
from flows.batch.batch_end import end_batch
from flows.batch.batch_report import WrittenReport
from flows.batch.early_end import EarlyEnd
from flows.document.references import numbered_finder
from flows.document.tested_batch import batch_plan
from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.entry.secret_guard import guarded
from flows.run.cancellation import cancel_with_flow_run
from flows.run.stage_run import require_success, run_name, run_stage
from flows.workers.crew import wanted_workers
from flows.workers.spread_batch import spread_batch
from specs.digest import canonical_document
from specs.errors import DocumentError, StageFailed
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate
from specs.pipeline.section_requests import simulation_request
from specs.pipeline.simulation_section import SimulationBatch
from specs.store_reference import StoreReference
from tasks.applications.task import unpack_application
from tasks.progress.task import show_progress
from tasks.results.tables.application_output import write_output
from tasks.results.tables.recordings import write_recordings
from tasks.results.task import write_tables
from tasks.simulate.batch.chunk_store import spent_s
from tasks.simulate.batch.job import (
    GOING,
    KIND,
    OpenBatch,
    close_batch,
    complete,
    load_batch,
    open_batch,
    require_plan,
    time_out,
)
from tasks.simulate.batch.metrics import BatchMeter
from tasks.simulate.batch.provenance import batch_metadata, note_machine
from tasks.simulate.batch.result_stream import result_parts
from tasks.simulate.plan.resolve import output_location
from tasks.simulate.task import audit_batch, simulate_chunk
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.store_url import open_store, store_id


@guarded
@flow(
    name="simulation-batch",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def simulation_batch(
    spec: SimulationBatch,
    worlds: list[str] | None = None,
    store: StoreReference = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    gate: Gate | None = None,
) -> JobRecord:
    """Returns the batch, whose ``detail`` says where results and failures lie and what they add up to.

    Args:
        spec: The pipeline's section ``simulationBatch``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        gate: Given by the pipeline if its gate may end the batch early.

    Raises:
        DocumentError: A request cannot be run, or names what does not exist.
        StageFailed: The batch timed out, was cancelled, or failed for a reason of Simyard's own.
    """
    wanted_workers()  # refuses workers that are not installed, before anything is recorded
    at = open_store(store)
    plan = batch_plan(spec, worlds or [], at, numbered_finder(at, versions), gate)
    location = output_location(spec)

    def work(given: str) -> JobRecord:
        request = simulation_request(spec, store_id=store_id(at), token=given)
        record = open_batch(at, plan, canonical_document(request), request.clientRequestToken or given)
        require_plan(at, record.id, plan)
        if is_terminal(record):
            return require_success(record)
        return require_success(_run(at, record.id, location, gate))

    identity = {"spec": canonical_document(spec), "plan": plan.model_dump(mode="json")}
    return completed_job(run_stage(at, "simulation-batch", identity, token, work))


def _run(store: Store, batch: str, location: OutputLocation, gate: Gate | None = None) -> JobRecord:
    with hold_claim(store, claim_key(KIND, batch)):
        work = load_batch(store, batch)
        record = work.record()
        if is_terminal(record):  # a cancellation closed it while this process waited for the claim
            return record
        try:
            folders = {digest: unpack_application(store.url, digest) for digest in work.plan.digests()}
            early = _simulate(work, folders, location, gate)
            return _close(work, folders, location, early)
        except (DocumentError, StageFailed) as exc:
            close_batch(store, batch, "Failed", {}, str(exc))
            raise


def _simulate(
    batch: OpenBatch, folders: dict[str, Path], location: OutputLocation, gate: Gate | None
) -> dict[str, JsonValue]:
    """Commits all chunks, or those before the batch is cancelled or its time is over.

    Returns the batch's speed, and why it ended early, if it did.
    """
    workers = None if batch.plan.shuffled else wanted_workers()  # an early end is decided chunk by chunk, in order
    if workers:
        return metric_fields(spread_batch(batch, location, workers))
    early, meter = EarlyEnd(batch, gate), BatchMeter()
    note_machine(batch)
    _simulate_here(batch, folders, location, early, meter)
    return {**early.detail, **metric_fields(meter.metrics())}


def _simulate_here(
    batch: OpenBatch, folders: dict[str, Path], location: OutputLocation, early: EarlyEnd, meter: BatchMeter
) -> None:
    """Commits the chunks one after the other in this process."""
    layout, store_url = batch.layout, batch.store.url
    record = partial(write_recordings, store_url, location, batch.id) if batch.plan.records() else None
    output = partial(write_output, store_url, location, batch.id)
    before_s, start_s = spent_s(batch.store, batch.id), time.monotonic()
    lanes, done = batch.plan.lanes, 0
    with show_progress("Episodes", "episodes-progress") as progress:
        for number in range(layout.chunks):
            worked_s = before_s + time.monotonic() - start_s
            left_s = batch.plan.timeout_s - worked_s
            now = time_out(batch) if left_s <= 0 else batch.record()
            if now.status not in GOING:
                return
            if early.ends_before(number):
                break
            progress(done, layout.episodes)

            def tell(finished: int, done: int = done) -> None:
                progress(done + finished, layout.episodes)

            ended = simulate_chunk(
                store_url,
                batch.id,
                number,
                bundles=folders,
                lanes=lanes,
                left_s=left_s,
                spent_s=worked_s,
                progress=tell,
                record=record,
                output=output,
            )
            lanes, done = ended.lanes, done + ended.episodes
            meter.add(ended.work, "")
        progress(layout.episodes, layout.episodes)


def _close(
    batch: OpenBatch, folders: dict[str, Path], location: OutputLocation, more: dict[str, JsonValue]
) -> JobRecord:
    """Returns the batch in its terminal state, with its tables, audit and report."""
    record = complete(batch)
    if is_terminal(record):
        return record
    audit = partial(_audit, batch, folders, location)
    end = end_batch(batch, record, location, write_tables=_write_tables, audit=audit, more=more)
    show_metrics(end.record)
    if isinstance(end.report, WrittenReport):
        show_batch_report(end.report)
    return end.record


def _write_tables(batch: OpenBatch, location: OutputLocation, status: str) -> dict[str, JsonValue]:
    return write_tables(
        batch.store.url,
        batch.id,
        lambda: result_parts(batch, status),
        variables=batch.plan.variables(),
        location=location,
        metadata=batch_metadata(batch.plan.lanes),
    )


def _audit(batch: OpenBatch, folders: dict[str, Path], location: OutputLocation) -> dict[str, JsonValue]:
    """Returns what the batch's record says of its audit; nothing if it is turned off."""
    lanes = min(batch.plan.audit, batch.layout.episodes)
    if lanes == 0:
        return {}
    with show_progress("Audit (driven twice)", "audit-progress") as progress:
        return audit_batch(
            batch.store.url,
            batch.id,
            bundles=folders,
            location=location,
            progress=lambda done: progress(done, 2 * lanes),
        )
