"""The pipeline: composes four stages - worlds, their export, the batch, the gate with its deployment - to a run.

Whoever knows Prefect reads the functions below as its flows: `pipeline`, and one for each stage. `flows.prefect.flows`
makes them flows, with the parameters and the help that stand here; `flows.prefect.tasks` makes a task of each step that
`run_step` names. Nothing here imports Prefect. `orchestrator()` is Prefect inside a flow, and this process alone
anywhere else, so that a run without a server is the same lines.
"""

import logging
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial, reduce
from pathlib import Path
from typing import TypeVar, cast

from pydantic import JsonValue

from flows.batch.batch_end import MissingReport, WrittenReport, write_report, write_report_of_run
from flows.batch.batch_steps import EPISODES
from flows.batch.trend_history import write_trend_of_run
from flows.pipeline.batch_run import begin_simulation_process, run_batch
from flows.pipeline.orchestrator import orchestrator, run_step
from flows.pipeline.recount import authenticated_record, planned_run, recount_changes
from flows.pipeline.references import ParsedRun, deployed_version, numbered_finder, resolve_references
from flows.pipeline.run_gate import (
    evidence_changes,
    gate_answer,
    judge_batch,
    refusal_report,
    shippable,
    withdraw_deployment,
)
from flows.pipeline.run_turns import begin_run_in_turn, cancelable_run, require_success, run_stage
from flows.pipeline.stage_report import (
    batch_report,
    deployment_report,
    evidence_of,
    export_report,
    gate_report,
    generation_report,
    joined,
    recorded_report,
    run_with_alarm,
    texts,
    with_alarm,
)
from flows.pipeline.tested_batch import batch_plan
from flows.resources.fleet_membership import renew_metadata_here
from flows.resources.kinds import require_not_canceled
from specs.arn import arn
from specs.base import canonical_document
from specs.data.run_report import Artefact, PipelineReport, StageName, StageReport
from specs.errors import ConcurrentDeployment, DocumentError, PipelineNotPassed, ResourceNotFound, StageFailed
from specs.field_types import Architecture
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate, stops_early
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
from specs.robomaker.failure_codes import JobFailureCode
from specs.template.body import template_digest
from tasks.deploy.step import robot_reserve, roll_out, section_signer
from tasks.documents.template_source import find_template
from tasks.export.step import draw_worlds, export_elsewhere, export_worlds
from tasks.progress.listener import at_a_time, current_listener, listen_to_progress
from tasks.results.gate.shipped_builds import shipment_of, version_changes
from tasks.simulate.batch.batch_record import KIND, open_batch, require_plan
from tasks.simulate.plan.plan_batch import output_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read
from tasks.storage.jobs.runs import stage_token, worlds_of_job
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.step import generate_worlds

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


def pipeline(spec: PipelineSpec, store: str | None = None, base: str = ".") -> PipelineReport:
    """Returns the report of a run in which everything passed.

    A run that was killed is continued; one that another live process works on is waited for.

    Args:
        spec: The document, or ``{document: path}``.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        base: Folder that the document's relative paths, or the path of its file, start from.

    Raises:
        DocumentError: The document refers to what does not exist; nothing has run.
        StageFailed: A stage ended Failed.
        PipelineNotPassed: The gate refused, or the deployment failed; carries the report.
    """
    orchestrator().wanted_workers()  # refuses workers that are not installed, before anything runs
    opened = open_store(store)
    found = resolve_references(spec, opened, Path(base))
    if spec.deployment and spec.deployment.trust == "signed":
        renew_metadata_here(opened)  # also on a night when the gate lets nothing pass
    identity: dict[str, JsonValue] = {"flow": "pipeline", "spec": canonical_document(spec), "pins": found.pins()}
    with orchestrator().announce_changes(), begin_run_in_turn(opened, identity) as run:
        work = ParsedRun(spec, base, opened, run, found)
        report = recorded_report(run) if is_terminal(run) else _run_to_end(work)
    orchestrator().show_run_report(report)
    if not report.passed:
        raise PipelineNotPassed(report)
    return report


def _run_to_end(work: ParsedRun) -> PipelineReport:
    """Returns the report of the run, which is in its terminal state then; a crash leaves it open to be continued."""
    store, run = work.store, work.run
    try:
        with cancelable_run(store, run), orchestrator().tag_run(run):
            report = _run_stages(work)
            if report.shipped is False:
                require_not_canceled(store, run)
    except ConcurrentDeployment:
        raise  # it passes: the same document continues this run when the fleet is free
    except (DocumentError, StageFailed) as exc:
        # As the stage has it.
        code = cast("JobFailureCode", exc.code if isinstance(exc, StageFailed) else "InvalidInput")
        refused = {"refused": isinstance(exc, DocumentError)}
        advance(store, "pipeline-run", run.id, "Failed", failure_code=code, failure_reason=str(exc), detail=refused)
        raise
    status = "Completed" if report.passed else "Failed"
    advance(store, "pipeline-run", run.id, status, detail={"report": report.model_dump(mode="json")})
    written = write_report_of_run(store, run)  # with what the stages took
    return run_with_alarm(report, written.alarm()) if isinstance(written, MissingReport) else report


def _run_stages(work: ParsedRun) -> PipelineReport:
    """Returns the report of the run of all stages that the document has, in their order."""
    prepare_simulation(work)
    worlds, generated = generate(work)
    require_not_canceled(work.store, work.run)
    work = replace(work, worlds=worlds)
    with robots_in_reserve(work.spec, work.store) as begin_robots:
        exported, (batch, simulated) = _export_and_simulate(work)
        require_not_canceled(work.store, work.run)
        begin_robots()
        simulated, judged, deployed = _judge_and_deploy(work, batch, simulated)
    verdict = judged[0].status if judged else None
    return PipelineReport.model_validate(
        {
            "run": work.run.id,
            "name": work.spec.name,
            "stages": (*generated, *exported, *simulated, *judged, *deployed),
            "verdict": verdict,
            "shipped": deployed[0].status == "Succeeded" if deployed and _passed(work.spec, verdict) else None,
        }
    )


def _export_and_simulate(work: ParsedRun) -> tuple[Reports, tuple[JobRecord | None, Reports]]:
    """Returns the report of the export, and the batch with its own; neither stage needs the other."""
    if orchestrator().wanted_workers():  # which do one stage after the other
        exported = export(work)
        require_not_canceled(work.store, work.run)
        return exported, simulate(work)
    return at_a_time(lambda: export(work), lambda: simulate(work))


def _judge_and_deploy(work: ParsedRun, batch: JobRecord | None, simulated: Reports) -> tuple[Reports, Reports, Reports]:
    """Returns the reports of the batch, with its trend, of the gate, and of the deployment.

    Args:
        work: The run.
        batch: The batch's record, or None.
        simulated: Its report until now.
    """
    tested = authenticated_batch(work, batch)
    judged = judge(work, tested)

    def show() -> tuple[Reports, Reports]:
        # With the verdict; and now, because the deployment may take long, or fail.
        if tested is None:
            return simulated, judged
        shown = _shown(judged, partial(_show_verdict, judged, work.store, tested)) if judged else judged
        return _shown(simulated, partial(_show_trend, simulated, work, tested)), shown

    def go_on() -> Reports:
        require_not_canceled(work.store, work.run)
        passed = _passed(work.spec, judged[0].status if judged else None)
        return deploy(work, tested) if passed else skip_deployment(work.spec)

    (simulated_shown, judged_shown), deployed = at_a_time(show, go_on)
    return simulated_shown, judged_shown, deployed


def _passed(spec: PipelineSpec, verdict: str | None) -> bool:
    return verdict == "PASS" or spec.gate is None


# The first stage: worlds.


def generate(work: ParsedRun) -> tuple[list[str], Reports]:
    """Returns the worlds of this run, and the stage's report."""
    section = work.spec.worldGeneration
    if section is None:
        return [], ()
    token = stage_token(work.run, "worlds")
    record, reports = _reported(
        "worldGeneration",
        lambda: run_step(world_generation, section, work.store.url, work.base, token),
        lambda record, seconds: generation_report(record, work.store, seconds),
    )
    return texts(record.detail, "worlds"), reports


def world_generation(
    spec: WorldGeneration, store: str | None = None, base: str = ".", token: str | None = None
) -> JobRecord:
    """Returns the generation job, whose ``detail["worlds"]`` names the worlds.

    Args:
        spec: The pipeline's section ``worldGeneration``, or ``{document: path}``.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        base: Folder that a template's relative path starts from.
        token: Given by the pipeline; None makes this a run of its own.

    Raises:
        StageFailed: No world could be made.
        DocumentError: The template is missing or none.
    """
    opened = open_store(store)
    makers = orchestrator().world_makers(opened)  # refuses workers that are not installed, before anything is recorded
    template = find_template(spec.template, opened, Path(base))
    digest = template_digest(template)

    make = partial(run_step, generate_worlds)
    if makers:  # they show a task run for each piece; one around them would hold what cannot be sent
        make = partial(generate_worlds, remote=makers)

    def work_part(given: str, part: GenerationPart, most: int) -> JobRecord:
        request = generation_request(spec, part, template=arn("world-template", store_id(opened), digest), token=given)
        record = make(
            opened.url,
            request,
            template,
            seed=spec.seed,
            token=request.clientRequestToken or given,
            robot_radius_m=spec.robotRadius,
            first=part.first,
            most=most,
        )
        run_step(draw_worlds, opened.url, require_success(record))
        return record

    def work(given: str) -> JobRecord:
        most = worlds_of_job(opened, given)
        return joined([work_part(given, part, most) for part in section_parts(spec, most)])

    identity = {"spec": canonical_document(spec), "template": digest}
    return run_stage(opened, "world-generation", identity, token, work)


# The second stage: their export.


def export(work: ParsedRun) -> Reports:
    """Returns the report of the export."""
    section = work.spec.worldExport
    if section is None:
        return ()
    worlds, token = [*work.worlds], stage_token(work.run, "export")
    return _reported(
        "worldExport", lambda: run_step(world_export, section, worlds, work.store.url, token), export_report
    )[1]


def world_export(
    spec: WorldExport, worlds: list[str] | None = None, store: str | None = None, token: str | None = None
) -> JobRecord:
    """Returns the export job, whose ``detail["zip"]`` says where the worlds lie.

    Args:
        spec: The pipeline's section ``worldExport``, or ``{document: path}``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        token: Given by the pipeline; None makes this a run of its own.

    Raises:
        StageFailed: The worlds could not be read or written; carries RoboMaker's code.
    """
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


# The third stage: the batch.


# Under Prefect each is a flow run of its own; see `flows.pipeline.orchestrator`.
def prepare_simulation(work: ParsedRun) -> None:
    """Begins the process that simulates, if the run is going to simulate here after other stages; returns at once."""
    before = work.spec.worldGeneration or work.spec.worldExport
    if work.found.batch and before and not orchestrator().wanted_workers() and _ended_batch(work) is None:
        begin_simulation_process(work.store, [*work.found.batch.digests()])


def simulate(work: ParsedRun) -> tuple[JobRecord | None, Reports]:
    """Returns the batch, and the stage's report.

    What an ended batch tested is not looked up anew: if that has changed since, the deployment is refused.
    """
    section = work.spec.simulationBatch
    if section is None:
        return None, ()
    ended = _ended_batch(work)
    if ended is not None:
        return ended, _logged(batch_report(ended, 0.0))
    worlds, numbers, token = [*work.worlds], work.found.numbers(), stage_token(work.run, "batch")
    gate = work.spec.gate if stops_early(work.spec.gate) else None
    return _reported(
        "simulationBatch",
        lambda: run_step(simulation_batch, section, worlds, work.store.url, numbers, token, gate=gate),
        batch_report,
    )


def simulation_batch(
    spec: SimulationBatch,
    worlds: list[str] | None = None,
    store: str | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    gate: Gate | None = None,
) -> JobRecord:
    """Returns the batch, whose ``detail`` says where results and failures lie and what they add up to.

    Args:
        spec: The pipeline's section ``simulationBatch``, or ``{document: path}``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        gate: Given by the pipeline if its gate may end the batch early.

    Raises:
        DocumentError: A request cannot be run, or names what does not exist.
        StageFailed: The batch timed out, was cancelled, or failed for a reason of Simyard's own.
    """
    orchestrator().wanted_workers()  # refuses workers that are not installed, before anything is recorded
    at = open_store(store)
    plan = batch_plan(spec, worlds or [], at, numbered_finder(at, versions), gate)

    def work(given: str) -> JobRecord:
        request = simulation_request(spec, store_id=store_id(at), token=given)
        record = open_batch(at, plan, canonical_document(request), request.clientRequestToken or given)
        require_plan(at, record.id, plan)
        if not is_terminal(record):
            record = run_batch(at, record.id, output_location(spec), gate)
        return require_success(record)

    identity = {"spec": canonical_document(spec), "plan": plan.model_dump(mode="json")}
    return run_stage(at, "simulation-batch", identity, token, work)


def _ended_batch(work: ParsedRun) -> JobRecord | None:
    """Returns the batch of a run that goes on after it, or None."""
    try:
        record = read(work.store, KIND, job_id(KIND, stage_token(work.run, "batch")))
    except ResourceNotFound:
        return None
    return record if record.status == "Completed" else None


# The fourth stage: the gate, and the deployment that it lets pass.


def authenticated_batch(work: ParsedRun, batch: JobRecord | None) -> JobRecord | None:
    """Returns the batch's record as its owner authenticates it, if a gate is to judge it.

    Args:
        work: The run.
        batch: The batch's record, as the store has it, or None.

    Raises:
        StageFailed: The batch is not what its record says.
    """
    section = work.spec.simulationBatch
    if section is None or batch is None or work.spec.gate is None:
        return batch
    return authenticated_record(batch, work.store, work.spec.gate, lambda: planned_run(work, section))


def judge(work: ParsedRun, batch: JobRecord | None) -> Reports:
    """Returns the report of the gate on a batch; nothing if there is none of them."""
    gate, store, run = work.spec.gate, work.store, work.run
    if gate is None or batch is None:
        return ()
    logger.info("the %s begins", _WORDS["gate"])
    answer, seconds = _measure(
        lambda: gate_answer(gate, batch, store, run, work.found.ships, judged=partial(run_step, judge_batch))
    )
    fields = {"verdict": answer.verdict, "evidence": answer.evidence_url, "batch": batch.arn}
    logger.info("the gate of %s says %s", run.arn, answer.sentence, extra={"fields": fields})
    orchestrator().announce_asset(evidence_of(store, answer))
    # Again by who goes on with the run: the event of a process that was killed may not have been sent.
    orchestrator().announce_verdict(answer, run, batch)
    return (gate_report(answer.verdict, answer.sentence, answer.evidence_url, seconds, answer.rooms),)


def deploy(work: ParsedRun, batch: JobRecord | None) -> Reports:
    """Returns the report of the roll-out of the application that the batch tested.

    Right before, all that the gate saw is compared with its evidence, and counted again; if anything has changed,
    nothing is shipped.

    Args:
        work: The run.
        batch: The record of the batch that was tested, or None.
    """
    spec, store, run, ships = work.spec, work.store, work.run, work.found.ships
    section, gated = spec.deployment, spec.gate is not None
    if section is None:
        return ()
    logger.info("the %s begins", _WORDS["deployment"])
    token, numbers = stage_token(run, "deployment"), work.found.numbers()
    tested = shippable(batch, store, run) if batch else None
    version = deployed_version(section, store, work.find(), tested)
    settled = ships or shipment_of(section, version)

    def changes() -> list[str]:
        changed = [*version_changes(settled, version)] if gated else []
        changed += evidence_changes(version.digest, store, run, gated=gated, ships=ships)
        return changed or recount_changes(work, batch)

    found, seconds = _measure(changes)
    if found:
        withdraw_deployment(store, section.clientRequestToken or token)
        return _logged(refusal_report(found, seconds))
    builds = settled.digests() if gated else None
    record, seconds = _measure(
        lambda: run_step(deployment_sync, section, store.url, tested, numbers, token, builds=builds)
    )
    return _logged(deployment_report(record, seconds))


def deployment_sync(
    spec: Deployment,
    store: str | None = None,
    tested: dict[str, str] | None = None,
    versions: dict[str, str] | None = None,
    token: str | None = None,
    *,
    builds: dict[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job, ended: Succeeded, Failed or Canceled.

    Args:
        spec: The pipeline's section ``deployment``, or ``{document: path}``.
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.
        tested: Digest of each robot application that a batch tested, by name; another digest is refused.
        versions: Numbers of applications to prefer over the newest, by ``<kind>/<name>``; given by the pipeline.
        token: Given by the pipeline; None makes this a run of its own.
        builds: Digest of the version's bundle for each architecture, as the pipeline settled them; others are refused.

    Raises:
        DocumentError: The fleet, application or version does not exist, or is not what was tested; or there are no
            keys to sign with.
    """
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


def skip_deployment(spec: PipelineSpec) -> Reports:
    """Returns the report of a deployment that the gate stopped."""
    if spec.deployment is None:
        return ()
    summary = "nothing was deployed: the gate did not pass"
    return _logged(StageReport(name="deployment", arn="", status="Skipped", summary=summary, seconds=0.0))


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


# What a stage came to: told to the log, and shown.


def _reported(stage: StageName, work: Callable[[], T], report: Callable[[T, float], StageReport]) -> tuple[T, Reports]:
    """Returns what a stage's work returns, and the stage's report; the log is told of its begin and its end."""
    logger.info("the %s begins", _WORDS[stage])
    result, seconds = _measure(work)
    return result, _logged(report(result, seconds))


def _logged(report: StageReport) -> Reports:
    """Returns a stage's report, having told the log what came of the stage."""
    fields = {"stage": report.name, "arn": report.arn, "status": report.status, "seconds": round(report.seconds, 3)}
    words = _WORDS[report.name]
    logger.info(
        "the %s is %s after %.1f s: %s", words, report.status, report.seconds, report.summary, extra={"fields": fields}
    )
    return (report,)


def _measure(work: Callable[[], T]) -> tuple[T, float]:
    start_s = time.perf_counter()
    return work(), time.perf_counter() - start_s


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


def _show_trend(simulated: Reports, work: ParsedRun, batch: JobRecord) -> Reports:
    """Returns the batch's report, the trend of the document being written; with an alarm for each rate that fell."""
    written = write_trend_of_run(work.store, work.run, batch)
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
