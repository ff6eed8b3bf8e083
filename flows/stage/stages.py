"""The pipeline's stages: each runs its section, if the document has it, and returns a report.

Under Prefect each is a flow run of its own; see `flows.stage.orchestrator`.
"""

import logging
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import TypeVar, cast

from flows.batch.batch_steps import EPISODES
from flows.document.references import Numbers, deployed_version, numbered_finder
from flows.gate.judge import GateAnswer, gate_answer, judge_batch
from flows.gate.shipment import evidence_changes, refusal_report, shippable, withdraw_deployment
from flows.recount.batch_recount import vouched_record
from flows.recount.recount import Asked, asked_plan, recount_changes
from flows.stage.assets import evidence_of
from flows.stage.batch_stage import begin_simulation_process, simulation_batch
from flows.stage.deployment_stage import deployment_sync
from flows.stage.export_stage import world_export
from flows.stage.generation_stage import world_generation
from flows.stage.orchestrator import orchestrator, run_step
from flows.stage.stage_summary import (
    batch_report,
    deployment_report,
    export_report,
    gate_report,
    generation_report,
    texts,
)
from specs.data.run_report import StageName, StageReport
from specs.errors import ResourceNotFound
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import stops_early
from tasks.deploy.step import robot_reserve
from tasks.progress.listener import current_listener, listen_to_progress
from tasks.results.gate.shipped_builds import Shipment, shipment_of, version_changes
from tasks.simulate.batch.job import KIND
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, job_id, read
from tasks.storage.jobs.runs import stage_token

T = TypeVar("T")
Reports = tuple[StageReport, ...]
# What the log calls each stage.
_WORDS: Mapping[StageName, str] = {
    "worldGeneration": "world generation",
    "worldExport": "world export",
    "simulationBatch": "simulation batch",
    "gate": "gate",
    "deployment": "deployment",
}
logger = logging.getLogger(__name__)


def prepare_simulation(spec: PipelineSpec, store: Store, run: JobRecord) -> None:
    """Begins the process that simulates, if the run is going to simulate here after other stages; returns at once.

    Args:
        spec: The document.
        store: The run's store.
        run: The run's record, which names what it tests.
    """
    before = spec.worldGeneration or spec.worldExport
    if spec.simulationBatch is None or not before or orchestrator().wanted_workers() or _ended_batch(store, run):
        return
    pinned = cast("Mapping[str, Mapping[str, Mapping[str, list[str]]]]", run.request)["pins"]["batch"]["bundles"]
    begin_simulation_process(store, pinned)


def generate(spec: PipelineSpec, store: Store, base: str, run: JobRecord) -> tuple[list[str], Reports]:
    """Returns the worlds of this run, and the stage's report.

    Args:
        spec: The document.
        store: The run's store.
        base: Folder that the document's relative paths start from.
        run: The run's record.
    """
    section = spec.worldGeneration
    if section is None:
        return [], ()
    _log_begin("worldGeneration")
    record, seconds = _measure(lambda: run_step(world_generation, section, store.url, base, stage_token(run, "worlds")))
    return texts(record.detail, "worlds"), _ended(generation_report(record, store, seconds))


def export(spec: PipelineSpec, worlds: list[str], store: Store, run: JobRecord) -> Reports:
    """Returns the report of the export.

    Args:
        spec: The document.
        worlds: ``<generation>/<world>`` of each world of this run.
        store: The run's store.
        run: The run's record.
    """
    section = spec.worldExport
    if section is None:
        return ()
    _log_begin("worldExport")
    record, seconds = _measure(lambda: run_step(world_export, section, worlds, store.url, stage_token(run, "export")))
    return _ended(export_report(record, seconds))


def simulate(
    spec: PipelineSpec, worlds: list[str], store: Store, versions: Numbers, run: JobRecord
) -> tuple[JobRecord | None, Reports]:
    """Returns the batch, and the stage's report.

    Args:
        spec: The document.
        worlds: ``<generation>/<world>`` of each world of this run.
        store: The run's store.
        versions: Numbers of the applications that the document brings, by ``<kind>/<name>``.
        run: The run's record.
    """
    section = spec.simulationBatch
    if section is None:
        return None, ()
    ended = _ended_batch(store, run)
    if ended is not None:
        return ended, _ended(batch_report(ended, 0.0))
    _log_begin("simulationBatch")
    gate, token = spec.gate if stops_early(spec.gate) else None, stage_token(run, "batch")
    record, seconds = _measure(
        lambda: run_step(simulation_batch, section, worlds, store.url, versions, token, gate=gate)
    )
    return record, _ended(batch_report(record, seconds))


def vouch(
    spec: PipelineSpec, batch: JobRecord | None, worlds: list[str], store: Store, versions: Numbers
) -> JobRecord | None:
    """Returns the batch's record as its owner vouches for it, if a gate is to judge it.

    Args:
        spec: The document.
        batch: The batch's record, as the store has it, or None.
        worlds: ``<generation>/<world>`` of each world of this run.
        store: The run's store.
        versions: Numbers of the applications that the document brings, by ``<kind>/<name>``.

    Raises:
        StageFailed: The batch is not what its record says.
    """
    section = spec.simulationBatch
    if section is None or batch is None or spec.gate is None:
        return batch
    asked = Asked(spec, ".", versions, worlds)
    return vouched_record(batch, store, spec.gate, lambda: asked_plan(asked, section, store))


def judge_batch_stage(
    spec: PipelineSpec, batch: JobRecord | None, store: Store, run: JobRecord, ships: Shipment | None = None
) -> Reports:
    """Returns the report of the gate.

    Args:
        spec: The document.
        batch: The batch's record, or None.
        store: The run's store.
        run: The run's record.
        ships: What the run ships if the gate passes, as it was settled before anything ran.
    """
    gate = spec.gate
    if gate is None or batch is None:
        return ()
    _log_begin("gate")
    answer, seconds = _measure(
        lambda: gate_answer(gate, batch, store, run, ships, judged=partial(run_step, judge_batch))
    )
    logger.info("the gate of %s says %s", run.arn, answer.sentence, extra={"fields": _verdict_fields(answer, batch)})
    orchestrator().announce_asset(evidence_of(store, answer))
    # Again by who goes on with the run: the event of a process that was killed may not have been sent.
    orchestrator().announce_verdict(answer, run, batch)
    return (gate_report(answer.verdict, answer.sentence, answer.evidence_url, seconds, answer.rooms),)


def deploy(asked: Asked, batch: JobRecord | None, store: Store, run: JobRecord) -> Reports:
    """Returns the report of the roll-out of the application that the batch tested.

    Right before, all that the gate saw is compared with its evidence, and counted again; if anything has changed,
    nothing is shipped.

    Args:
        asked: The document, and what this process knows of it.
        batch: The record of the batch that was tested, or None.
        store: The run's store.
        run: The run's record.
    """
    spec, versions = asked.spec, asked.versions
    section = spec.deployment
    if section is None:
        return ()
    _log_begin("deployment")
    token = stage_token(run, "deployment")
    tested = shippable(batch, store, run) if batch else None
    version = deployed_version(section, store, numbered_finder(store, versions), tested)
    settled = asked.ships or shipment_of(section, version)
    builds = settled.digests() if spec.gate else None
    changed = [*version_changes(settled, version)] if spec.gate else []
    found, seconds = _measure(
        lambda: (
            [
                *changed,
                *evidence_changes(version.digest, store, run, gated=spec.gate is not None, ships=asked.ships),
            ]
            or recount_changes(asked, batch, store, run)
        )
    )
    if found:
        withdraw_deployment(store, section.clientRequestToken or token)
        return _ended(refusal_report(found, seconds))
    record, seconds = _measure(
        lambda: run_step(deployment_sync, section, store.url, tested, versions, token, builds=builds)
    )
    return _ended(deployment_report(record, seconds))


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


def skip_deployment(spec: PipelineSpec) -> Reports:
    """Returns the report of a deployment that the gate stopped."""
    if spec.deployment is None:
        return ()
    summary = "nothing was deployed: the gate did not pass"
    return _ended(StageReport(name="deployment", arn="", status="Skipped", summary=summary, seconds=0.0))


def _ended_batch(store: Store, run: JobRecord) -> JobRecord | None:
    """Returns the batch of a run that goes on after it, or None.

    What it tested is not looked up anew: if that has changed since, the deployment is refused with the reason.
    """
    try:
        record = read(store, KIND, job_id(KIND, stage_token(run, "batch")))
    except ResourceNotFound:
        return None
    return record if record.status == "Completed" else None


def _log_begin(stage: StageName) -> None:
    logger.info("the %s begins", _WORDS[stage])


def _ended(report: StageReport) -> Reports:
    """Returns a stage's report, having told the log what came of the stage."""
    fields = {"stage": report.name, "arn": report.arn, "status": report.status, "seconds": round(report.seconds, 3)}
    words = _WORDS[report.name]
    logger.info(
        "the %s is %s after %.1f s: %s", words, report.status, report.seconds, report.summary, extra={"fields": fields}
    )
    return (report,)


def _verdict_fields(answer: GateAnswer, batch: JobRecord) -> dict[str, str]:
    return {"verdict": answer.verdict, "evidence": answer.evidence_url, "batch": batch.arn}


def _measure(work: Callable[[], T]) -> tuple[T, float]:
    start_s = time.perf_counter()
    return work(), time.perf_counter() - start_s
