"""The four stages of a pipeline as plain functions: worlds, their export, the batch, the roll-out.

Each is a part of a pipeline's run, or a run of its own. It asks the orchestrator of its context to run its steps, so
that the same function runs with Prefect's server and without.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import cast

from pydantic import JsonValue

from flows.batch.batch_end import WrittenReport, end_batch
from flows.batch.batch_steps import EPISODES, SequentialStop, audit_batch, simulate_chunk, unusable_bundle, write_tables
from flows.pipeline.orchestrator import orchestrator, run_step
from flows.pipeline.references import deployed_version, numbered_finder
from flows.pipeline.run_turns import begin_run_in_turn, cancelable_run
from flows.pipeline.stage_report import JOBS, made_by
from flows.pipeline.tested_batch import batch_plan
from flows.resources.kinds import REASON
from specs.arn import arn
from specs.base import canonical_document
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.field_types import Architecture, OutputLocation
from specs.pipeline.gate_section import Gate
from specs.pipeline.generation_parts import GenerationPart
from specs.pipeline.section_requests import (
    deployment_request,
    export_request,
    generation_request,
    reference_arn,
    section_parts,
    simulation_request,
)
from specs.pipeline.simulation_section import Deployment, SimulationBatch
from specs.pipeline.world_sections import WorldExport, WorldGeneration
from specs.settings import Workers
from specs.template.body import template_digest
from tasks.applications.registry import BUNDLE_ERRORS
from tasks.applications.step import unpack_application
from tasks.deploy.step import roll_out, section_signer
from tasks.documents.template_source import find_template
from tasks.export.step import draw_worlds, export_elsewhere, export_worlds
from tasks.simulate.batch.batch_record import (
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
from tasks.simulate.batch.chunk_run import chunks_ahead, forget_chunks
from tasks.simulate.batch.chunk_store import chunk_numbers, spent_s
from tasks.simulate.batch.metrics import METRICS, BatchMeter, BatchMetrics
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.chunk.byproducts import collect_timings
from tasks.simulate.forecast.batch_timing import BatchWatch
from tasks.simulate.plan.plan_batch import output_location
from tasks.simulate.sandbox.process_pool import prepare_simulator
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal
from tasks.storage.jobs.runs import stage_token
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.step import generate_on_workers, generate_worlds

_FAILED = frozenset({"Failed", "TimedOut", "Canceled"})


def run_stage(
    store: Store, stage: str, identity: Mapping[str, JsonValue], token: str | None, work: Callable[[str], JobRecord]
) -> JobRecord:
    """Returns the job that the work ended, in a run of its own when no token says that it is part of another's.

    Work is recognised by its token, so that this returns the job of a run that another process ended meanwhile.

    Args:
        store: Where runs are recorded.
        stage: The flow's name.
        identity: All that decides the outcome, for the run's number.
        token: The pipeline's token for this stage, or None.
        work: Does the stage under a token; doing it again changes nothing.
    """
    if token is not None:
        return _announced(store, work(token), token)
    with (
        orchestrator().announce_changes(),
        begin_run_in_turn(store, {"flow": stage, **identity}) as run,
    ):
        return _work_in_run(store, stage, run, work)


def _work_in_run(store: Store, stage: str, run: JobRecord, work: Callable[[str], JobRecord]) -> JobRecord:
    if run.status == "Canceled":  # maybe before it had a job, and none begins now
        raise StageFailed(run.failure_code, run.failure_reason, run.arn)
    try:
        with cancelable_run(store, run), orchestrator().tag_run(run):
            record = _announced(store, work(stage_token(run, stage)))
    except (DocumentError, StageFailed) as exc:
        advance(store, "pipeline-run", run.id, "Failed", failure_reason=str(exc))
        raise
    advance(store, "pipeline-run", run.id, "Completed", detail={"arn": record.arn})
    return record


def _announced(store: Store, job: JobRecord, token: str = "") -> JobRecord:
    """Returns the job, having told of what it made."""
    made = made_by(store, job, token)
    if made is not None:
        orchestrator().announce_asset(made)
    return job


def require_success(record: JobRecord) -> JobRecord:
    """Returns the record of a job that made something.

    Raises:
        StageFailed: The job Failed, TimedOut or was Canceled; carries its code and reason.
    """
    if record.status in _FAILED:
        reason = record.failure_reason or (REASON if record.status == "Canceled" else record.status)
        raise StageFailed(record.failure_code or record.status, reason, record.arn)
    return record


def world_generation(
    spec: WorldGeneration, store: str | None = None, base: str = ".", token: str | None = None
) -> JobRecord:
    """Returns the generation job; see the flow `flows.prefect.flows.world_generation`."""
    opened = open_store(store)
    makers = orchestrator().world_makers(opened)  # refuses workers that are not installed, before anything is recorded
    template = find_template(spec.template, opened, Path(base))
    digest = template_digest(template)

    make = partial(run_step, generate_worlds)
    if makers:  # they show a task run for each piece; one around them would hold what cannot be sent
        make = partial(generate_on_workers, remote=makers)

    def work_part(given: str, part: GenerationPart) -> JobRecord:
        request = generation_request(spec, part, template=arn("world-template", store_id(opened), digest), token=given)
        record = make(
            opened.url,
            request,
            template,
            seed=spec.seed,
            token=request.clientRequestToken or given,
            robot_radius_m=spec.robotRadius,
            first=part.first,
        )
        run_step(draw_worlds, opened.url, require_success(record))
        return record

    def work(given: str) -> JobRecord:
        return joined([work_part(given, part) for part in section_parts(spec)])

    identity = {"spec": canonical_document(spec), "template": digest}
    return run_stage(opened, "world-generation", identity, token, work)


def joined(jobs: Sequence[JobRecord]) -> JobRecord:
    """Returns the first of a section's generation jobs, with the worlds and the failures of all of them.

    The store keeps each job as it is; what they are together is nowhere but in the run.

    Args:
        jobs: Ended ones, in order, at least one.
    """
    first, *more = jobs
    if not more:
        return first
    failures: dict[str, JsonValue] = {}
    for job in jobs:
        for code, each in cast("Mapping[str, Mapping[str, JsonValue]]", job.detail["failures"]).items():
            known = cast("Mapping[str, JsonValue]", failures.get(code, {"count": 0, **each} | {"count": 0}))
            failures[code] = {**known, "count": cast("int", known["count"]) + cast("int", each["count"])}
    worlds: list[JsonValue] = [world for job in jobs for world in cast("list[JsonValue]", job.detail["worlds"])]
    detail = {**first.detail, "worlds": worlds, "failures": failures, JOBS: [job.id for job in jobs]}
    return first.model_copy(update={"detail": detail, "status": "PartialFailed" if failures else first.status})


def world_export(
    spec: WorldExport, worlds: list[str] | None = None, store: str | None = None, token: str | None = None
) -> JobRecord:
    """Returns the export job; see the flow `flows.prefect.flows.world_export`."""
    opened = open_store(store)
    writers = orchestrator().world_writers(opened)  # refuses workers that are not installed, before anything begins
    chosen = tuple(worlds or ()) if spec.worlds == "all" else spec.worlds
    if not chosen:
        allowed = (
            "<generation>/<world> of each world, in this parameter or in spec.worlds; a run of this flow alone has none"
        )
        raise DocumentError.of("worlds", "none", allowed, source="parameters")
    references = [reference_arn("world", world, store_id(opened)) for world in chosen]

    def work(given: str) -> JobRecord:
        request = export_request(spec, worlds=references, token=given)
        job_token, formats = request.clientRequestToken or given, spec.formats
        write = partial(run_step, export_worlds)
        if writers:  # they show a task run for each piece; one around them would hold what cannot be sent
            write = partial(export_elsewhere, elsewhere=writers)
        return require_success(write(opened.url, request, formats=formats, token=job_token))

    identity: dict[str, JsonValue] = {"spec": canonical_document(spec), "worlds": [*chosen]}
    return run_stage(opened, "world-export", identity, token, work)


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
    """Returns the batch; see the flow `flows.prefect.flows.simulation_batch`."""
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
            if not _batch_workers(work) and _simulates(work):
                _begin_process(store, work.plan.digests())  # which imports JAX while the first chunk is made ready
            _unpack_bundles(work)
            watch = BatchWatch()
            with collect_timings() as driven:
                more, audit = _simulate_chunks(work, location, gate)
            watch.drove()
            with collect_timings() as audited:
                end = _close_batch(work, location, more, audit)
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


def _simulates(batch: OpenBatch) -> bool:
    """Returns whether episodes are left to simulate, or to audit."""
    return bool(batch.plan.audit) or len(chunk_numbers(batch.store, batch.id).committed) < batch.layout.chunks


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

    def tables(of: OpenBatch, place: OutputLocation, status: str) -> dict[str, JsonValue]:
        return run_step(write_tables, of.store.url, of.id, status, place).detail

    def audit() -> dict[str, JsonValue]:
        if audited or not batch.plan.audit:
            return audited
        return run_step(audit_batch, batch.store.url, batch.id, location)

    end = end_batch(batch, record, location, write_tables=tables, audit=audit, more=more)
    orchestrator().show_metrics(end.record)
    if isinstance(end.report, WrittenReport):
        orchestrator().show_batch_report(end.report)
    return end.record


def _metric_fields(metrics: BatchMetrics | None) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its speed; nothing if nothing was simulated."""
    return {METRICS: metrics.model_dump(mode="json")} if metrics else {}


def deployment_sync(
    spec: Deployment,
    store: str | None = None,
    tested: dict[str, str] | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    builds: dict[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job; see the flow `flows.prefect.flows.deployment_sync`."""
    opened = open_store(store)
    section_signer(opened, spec)  # refuses a document whose keys are not here, before anything is recorded
    version = deployed_version(spec, opened, numbered_finder(opened, versions), tested)

    def work(given: str) -> JobRecord:
        request = deployment_request(spec, store_id=store_id(opened), version=str(version.number), token=given)
        shipped = version.digests if builds is None else builds
        job_token = request.clientRequestToken
        return run_step(roll_out, opened.url, request, spec, digest=version.digest, builds=shipped, token=job_token)

    identity = {"spec": canonical_document(spec), "digest": version.digest}
    return run_stage(opened, "deployment-sync", identity, token, work)
