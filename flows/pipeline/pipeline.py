"""The pipeline: composes five stages - worlds, export, the batch, its search, the gate with its deployment - to a run.

Whoever knows Prefect reads the functions below as its flows: `pipeline`, and one for each stage. `flows.prefect.flows`
makes them flows, with the parameters and the help that stand here; `flows.prefect.tasks` makes a task of each step that
`run_step` names. Nothing here imports Prefect. `orchestrator()` is Prefect inside a flow, and this process alone
anywhere else, so that a run without a server is the same lines.
"""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from flows.batch.batch_end import MissingReport, write_report_of_run
from flows.batch.search_batch import search_batch
from flows.pipeline.batch_run import ended_batch, prepare_simulation, robots_in_reserve, run_batch
from flows.pipeline.orchestrator import Reports, orchestrator, run_step, show_trend, show_verdict, try_to_show
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
    import_report,
    joined,
    recorded_report,
    require_an_end,
    run_with_alarm,
    search_report,
    texts,
)
from flows.pipeline.tested_batch import batch_plan
from flows.resources.fleet_membership import renew_metadata_here
from flows.resources.kinds import require_not_canceled
from specs.arn import arn, parse_reference
from specs.base import canonical_document
from specs.data.run_report import PipelineReport, StageName, StageReport
from specs.errors import ConcurrentDeployment, DocumentError, PipelineNotPassed, StageFailed
from specs.field_types import Architecture
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate, stops_early
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
from tasks.deploy.step import roll_out, section_signer
from tasks.documents.template_source import find_template
from tasks.export.step import draw_imported, draw_worlds, export_elsewhere, export_worlds
from tasks.progress.listener import at_a_time
from tasks.results.gate.shipped_builds import shipment_of, version_changes
from tasks.results.statistics.found_failures import BatchSearch, write_search
from tasks.simulate.batch.batch_record import open_batch, require_plan
from tasks.simulate.plan.plan_batch import output_location
from tasks.storage.jobs.records import JobRecord, advance, is_terminal
from tasks.storage.jobs.runs import stage_token, worlds_of_job
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.step import generate_worlds

# What the log calls each stage.
_WORDS: Mapping[StageName, str] = {
    "worlds": "import of worlds",
    "worldGeneration": "world generation",
    "worldExport": "world export",
    "simulationBatch": "simulation batch",
    "search": "search",
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
        work = ParsedRun(found.placed(spec), base, opened, run, found)
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
    imported = show_imported(work)
    worlds, generated = generate(work)
    require_not_canceled(work.store, work.run)
    work = replace(work, worlds=[*work.found.imported_digests(), *worlds])
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
            "stages": (*imported, *generated, *exported, *simulated, *judged, *deployed),
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
    """Returns the reports of the batch, with its trend, and its search; of the gate; and of the deployment."""
    tested = authenticated_batch(work, batch)
    if tested is not None and work.spec.gate is None:
        require_an_end(tested)
    found, searched = search(work, tested)
    require_not_canceled(work.store, work.run)
    judged = judge(work, tested, found)

    def show() -> tuple[Reports, Reports]:
        # With the verdict; and now, because the deployment may take long, or fail.
        if tested is None:
            return simulated, judged
        if searched and not judged:
            try_to_show(searched, partial(show_verdict, searched, work.store, tested))
        shown = try_to_show(judged, partial(show_verdict, judged, work.store, tested)) if judged else judged
        return try_to_show(simulated, partial(show_trend, simulated, work.store, work.run, tested)), shown

    def go_on() -> Reports:
        require_not_canceled(work.store, work.run)
        passed = _passed(work.spec, judged[0].status if judged else None)
        return deploy(work, tested) if passed else skip_deployment(work.spec)

    (simulated_shown, judged_shown), deployed = at_a_time(show, go_on)
    return (*simulated_shown, *searched), judged_shown, deployed


def _passed(spec: PipelineSpec, verdict: str | None) -> bool:
    return verdict == "PASS" or spec.gate is None


# The first stage: worlds. Under Prefect each is a flow run of its own; see `flows.pipeline.orchestrator`.


def show_imported(work: ParsedRun) -> Reports:
    """Returns the report of the worlds that the document imports, which are in the store since it was resolved."""
    if not work.found.imported:
        return ()
    start_s = _begin("worlds")
    for worlds in work.found.imported_by_name().values():
        run_step(draw_imported, work.store.url, [each.reference for each in worlds])
    return _logged(import_report(work.found.imported_by_name(), work.store, _since(start_s)))


def generate(work: ParsedRun) -> tuple[list[str], Reports]:
    """Returns the worlds that this run generates, and the stage's report."""
    section = work.spec.worldGeneration
    if section is None:
        return [], ()
    start_s = _begin("worldGeneration")
    record = run_step(world_generation, section, work.store.url, work.base, stage_token(work.run, "worlds"))
    return texts(record.detail, "worlds"), _logged(generation_report(record, work.store, _since(start_s)))


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

    def work(given: str) -> JobRecord:
        most, name = worlds_of_job(opened, given), arn("world-template", store_id(opened), digest)
        jobs: list[JobRecord] = []
        for part in section_parts(spec, most):
            request = generation_request(spec, part, template=name, token=given)
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
            jobs.append(record)
        return joined(jobs)

    identity = {"spec": canonical_document(spec), "template": digest}
    return run_stage(opened, "world-generation", identity, token, work)


# The second stage: their export.


def export(work: ParsedRun) -> Reports:
    """Returns the report of the export."""
    section = work.spec.worldExport
    if section is None:
        return ()
    start_s = _begin("worldExport")
    record = run_step(world_export, section, [*work.worlds], work.store.url, stage_token(work.run, "export"))
    return _logged(export_report(record, _since(start_s)))


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
        allowed = "<generation>/<world> of each, in this parameter or in spec.worlds; a run of this flow alone has none"
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


def simulate(work: ParsedRun) -> tuple[JobRecord | None, Reports]:
    """Returns the batch, and the stage's report.

    What an ended batch tested is not looked up anew: if that has changed since, the deployment is refused.
    """
    section = work.spec.simulationBatch
    if section is None:
        return None, ()
    ended = ended_batch(work)
    if ended is not None:
        return ended, _logged(batch_report(ended, 0.0))
    start_s = _begin("simulationBatch")
    worlds, numbers, token = [*work.worlds], work.found.numbers(), stage_token(work.run, "batch")
    gate = work.spec.gate if stops_early(work.spec.gate) else None
    record = run_step(simulation_batch, section, worlds, work.store.url, numbers, token, gate=gate)
    return record, _logged(batch_report(record, _since(start_s)))


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


# The fourth stage: the search.


def search(work: ParsedRun, batch: JobRecord | None) -> tuple[BatchSearch | None, Reports]:
    """Returns the failures of the batch's robot that were found, and the stage's report; nothing where nobody asks."""
    section = work.spec.search
    if section is None or batch is None:
        return None, ()
    start_s = _begin("search")
    search_them = partial(run_step, search_batch)
    if workers := orchestrator().search_workers():  # as for worlds, they show a task run for each piece
        search_them = partial(search_batch, workers=workers)
    # The id is a string of its own; `flows.pipeline.run_gate` says why.
    found = search_them(work.store.url, parse_reference(batch.arn).path, section, run=work.run.id).found
    url = write_search(work.store, found)
    return found, _logged(search_report(found, url, _since(start_s)))


# The fifth stage: the gate, and the deployment that it lets pass.


def authenticated_batch(work: ParsedRun, batch: JobRecord | None) -> JobRecord | None:
    """Returns the batch's record as its owner authenticates it, if a gate is to judge it.

    Raises:
        StageFailed: The batch is not what its record says.
    """
    section = work.spec.simulationBatch
    if section is None or batch is None or work.spec.gate is None:
        return batch
    return authenticated_record(batch, work.store, work.spec.gate, lambda: planned_run(work, section))


def judge(work: ParsedRun, batch: JobRecord | None, searched: BatchSearch | None = None) -> Reports:
    """Returns the report of the gate on a batch; nothing if there is none of them.

    Args:
        work: The run.
        batch: The batch's record.
        searched: What its search found, where the document asks for one.
    """
    gate, store, run = work.spec.gate, work.store, work.run
    if gate is None or batch is None:
        return ()
    start_s = _begin("gate")
    judged = partial(run_step, judge_batch)
    answer = gate_answer(gate, batch, store, run, work.found.ships, judged=judged, searched=searched)
    seconds = _since(start_s)
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
    start_s = _begin("deployment")
    token, numbers = stage_token(run, "deployment"), work.found.numbers()
    tested = shippable(batch, store, run) if batch else None
    version = deployed_version(section, store, work.find(), tested)
    settled = ships or shipment_of(section, version)
    changed = [*version_changes(settled, version)] if gated else []
    changed += evidence_changes(version.digest, store, run, gated=gated, ships=ships)
    changed = changed or recount_changes(work, batch)
    if changed:
        withdraw_deployment(store, section.clientRequestToken or token)
        return _logged(refusal_report(changed, _since(start_s)))
    start_s, builds = time.perf_counter(), settled.digests() if gated else None
    record = run_step(deployment_sync, section, store.url, tested, numbers, token, builds=builds)
    return _logged(deployment_report(record, _since(start_s)))


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


# What a stage came to, told to the log.


def _begin(stage: StageName) -> float:
    """Returns when a stage begins, having told the log that it does."""
    logger.info("the %s begins", _WORDS[stage])
    return time.perf_counter()


def _since(start_s: float) -> float:
    return time.perf_counter() - start_s


def _logged(report: StageReport) -> Reports:
    """Returns a stage's report, having told the log what came of the stage."""
    fields = {"stage": report.name, "arn": report.arn, "status": report.status, "seconds": round(report.seconds, 3)}
    words = _WORDS[report.name]
    logger.info(
        "the %s is %s after %.1f s: %s", words, report.status, report.seconds, report.summary, extra={"fields": fields}
    )
    return (report,)
