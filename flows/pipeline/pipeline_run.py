"""A run of a whole document: composes the stages, from worlds to deployment, and reports on them.

Under Prefect each stage is a flow run of its own; see `flows.pipeline.orchestrator`.
"""

import logging
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext
from functools import partial, reduce
from pathlib import Path
from typing import TypeVar, cast

from pydantic import JsonValue

from flows.batch.batch_end import MissingReport, WrittenReport, write_report, write_report_of_run
from flows.batch.batch_steps import EPISODES
from flows.batch.trend_history import write_trend_of_run
from flows.pipeline.orchestrator import orchestrator, run_step
from flows.pipeline.recount import ParsedRun, authenticated_record, planned_run, recount_changes
from flows.pipeline.references import Numbers, deployed_version, numbered_finder, pinned_shipment, pins
from flows.pipeline.run_gate import (
    GateAnswer,
    evidence_changes,
    gate_answer,
    judge_batch,
    refusal_report,
    shippable,
    withdraw_deployment,
)
from flows.pipeline.run_turns import begin_run_in_turn, cancelable_run
from flows.pipeline.stage_report import (
    batch_report,
    deployment_report,
    evidence_of,
    export_report,
    gate_report,
    generation_report,
    recorded_report,
    run_with_alarm,
    texts,
    with_alarm,
)
from flows.pipeline.stages import (
    begin_simulation_process,
    deployment_sync,
    simulation_batch,
    world_export,
    world_generation,
)
from flows.resources.fleet_membership import renew_metadata_here
from flows.resources.kinds import require_not_canceled
from specs.base import canonical_document
from specs.data.run_report import Artefact, PipelineReport, StageName, StageReport
from specs.errors import ConcurrentDeployment, DocumentError, PipelineNotPassed, ResourceNotFound, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import stops_early
from specs.robomaker.failure_codes import JobFailureCode
from tasks.deploy.step import robot_reserve
from tasks.progress.listener import at_a_time, current_listener, listen_to_progress
from tasks.results.gate.shipped_builds import Shipment, shipment_of, version_changes
from tasks.simulate.batch.batch_record import KIND
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read
from tasks.storage.jobs.runs import stage_token
from tasks.storage.store_url import open_store

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
    return texts(record.detail, "worlds"), _reported(generation_report(record, store, seconds))


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
    return _reported(export_report(record, seconds))


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
        return ended, _reported(batch_report(ended, 0.0))
    _log_begin("simulationBatch")
    gate, token = spec.gate if stops_early(spec.gate) else None, stage_token(run, "batch")
    record, seconds = _measure(
        lambda: run_step(simulation_batch, section, worlds, store.url, versions, token, gate=gate)
    )
    return record, _reported(batch_report(record, seconds))


def authenticated_batch(
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
    asked = ParsedRun(spec, ".", versions, worlds)
    return authenticated_record(batch, store, spec.gate, lambda: planned_run(asked, section, store))


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


def deploy(asked: ParsedRun, batch: JobRecord | None, store: Store, run: JobRecord) -> Reports:
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
        return _reported(refusal_report(found, seconds))
    record, seconds = _measure(
        lambda: run_step(deployment_sync, section, store.url, tested, versions, token, builds=builds)
    )
    return _reported(deployment_report(record, seconds))


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
    return _reported(StageReport(name="deployment", arn="", status="Skipped", summary=summary, seconds=0.0))


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


def _reported(report: StageReport) -> Reports:
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


def pipeline(spec: PipelineSpec, store: str | None = None, base: str = ".") -> PipelineReport:
    """Returns the report of a run in which everything passed; see the flow `flows.prefect.flows.pipeline`."""
    orchestrator().wanted_workers()  # refuses workers that are not installed, before anything runs
    opened = open_store(store)
    found, own = pins(spec, opened, Path(base))
    if spec.deployment and spec.deployment.trust == "signed":
        renew_metadata_here(opened)  # also on a night when the gate lets nothing pass
    versions, ships = {key: str(version.number) for key, version in own.items()}, pinned_shipment(found)
    identity: dict[str, JsonValue] = {"flow": "pipeline", "spec": canonical_document(spec), "pins": found}
    with orchestrator().announce_changes(), begin_run_in_turn(opened, identity) as run:
        if is_terminal(run):
            report = recorded_report(run)
        else:
            report = _run_to_end(spec, opened, base, versions, run, ships=ships)
    orchestrator().show_run_report(report)
    if not report.passed:
        raise PipelineNotPassed(report)
    return report


def _run_to_end(
    spec: PipelineSpec, store: Store, base: str, versions: Numbers, run: JobRecord, *, ships: Shipment | None
) -> PipelineReport:
    """Returns the report of the run, which is in its terminal state then; a crash leaves it open to be continued."""
    try:
        with cancelable_run(store, run):
            report = _stages(spec, store, base, versions, run, ships=ships)
            if report.shipped is False:
                require_not_canceled(store, run)
    except ConcurrentDeployment:
        raise  # it passes: the same document continues this run when the fleet is free
    except (DocumentError, StageFailed) as exc:
        code = cast(
            "JobFailureCode", exc.code if isinstance(exc, StageFailed) else "InvalidInput"
        )  # as the stage has it
        refused = {"refused": isinstance(exc, DocumentError)}
        advance(store, "pipeline-run", run.id, "Failed", failure_code=code, failure_reason=str(exc), detail=refused)
        raise
    status = "Completed" if report.passed else "Failed"
    advance(store, "pipeline-run", run.id, status, detail={"report": report.model_dump(mode="json")})
    written = write_report_of_run(store, run)  # with what the stages took
    return run_with_alarm(report, written.alarm()) if isinstance(written, MissingReport) else report


def _stages(
    spec: PipelineSpec, store: Store, base: str, versions: Numbers, run: JobRecord, *, ships: Shipment | None
) -> PipelineReport:
    with orchestrator().tag_run(run):
        return _report(spec, store, base, versions, run, ships=ships)


def _report(
    spec: PipelineSpec, store: Store, base: str, versions: Numbers, run: JobRecord, *, ships: Shipment | None
) -> PipelineReport:
    prepare_simulation(spec, store, run)
    worlds, generation = generate(spec, store, base, run)
    require_not_canceled(store, run)
    asked = ParsedRun(spec, base, versions, worlds, ships)
    with robots_in_reserve(spec, store) as begin_robots:
        exported, (batch, simulated) = _export_and_simulate(spec, worlds, store, versions, run)
        require_not_canceled(store, run)
        begin_robots()
        simulated, judged, deployed = _judge_and_deploy(asked, batch, simulated, store, run)
    verdict = judged[0].status if judged else None
    return PipelineReport.model_validate(
        {
            "run": run.id,
            "name": spec.name,
            "stages": (*generation, *exported, *simulated, *judged, *deployed),
            "verdict": verdict,
            "shipped": deployed[0].status == "Succeeded" if deployed and _passed(spec, verdict) else None,
        }
    )


def _judge_and_deploy(
    asked: ParsedRun, batch: JobRecord | None, simulated: Reports, store: Store, run: JobRecord
) -> tuple[Reports, Reports, Reports]:
    """Returns the reports of the batch, with its trend, of the gate, and of the deployment.

    Args:
        asked: The document, and what this process knows of it.
        batch: The batch's record, or None.
        simulated: Its report until now.
        store: The run's store.
        run: The run's record.
    """
    spec = asked.spec
    tested = authenticated_batch(spec, batch, asked.worlds, store, asked.versions)
    judged = judge_batch_stage(spec, tested, store, run, asked.ships)

    def show() -> tuple[Reports, Reports]:
        # With the verdict; and now, because the deployment may take long, or fail.
        if tested is None:
            return simulated, judged
        shown = _shown(judged, partial(_show_verdict, judged, store, tested)) if judged else judged
        return _shown(simulated, partial(_show_trend, simulated, store, run, tested)), shown

    def go_on() -> Reports:
        require_not_canceled(store, run)
        passed = _passed(spec, judged[0].status if judged else None)
        return deploy(asked, tested, store, run) if passed else skip_deployment(spec)

    (simulated_shown, judged_shown), deployed = at_a_time(show, go_on)
    return simulated_shown, judged_shown, deployed


def _shown(stages: Reports, show: Callable[[], Reports]) -> Reports:
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


def _passed(spec: PipelineSpec, verdict: str | None) -> bool:
    return verdict == "PASS" or spec.gate is None


def _export_and_simulate(
    spec: PipelineSpec, worlds: list[str], store: Store, versions: Numbers, run: JobRecord
) -> tuple[Reports, tuple[JobRecord | None, Reports]]:
    """Returns the report of the export, and the batch with its own; neither stage needs the other."""
    if orchestrator().wanted_workers():  # which do one stage after the other
        exported = export(spec, worlds, store, run)
        require_not_canceled(store, run)
        return exported, simulate(spec, worlds, store, versions, run)
    return at_a_time(lambda: export(spec, worlds, store, run), lambda: simulate(spec, worlds, store, versions, run))


def _show_trend(simulated: Reports, store: Store, run: JobRecord, batch: JobRecord) -> Reports:
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


def _show_verdict(judged: Reports, store: Store, batch: JobRecord) -> Reports:
    """Returns the gate's report, the batch's page being written; with an alarm where it could not be."""
    written = write_report(store, batch)
    if isinstance(written, WrittenReport):
        orchestrator().show_batch_report(written)
        return judged
    return tuple(with_alarm(stage, written.alarm()) for stage in judged)
