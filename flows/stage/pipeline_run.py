"""A run of a whole document, from worlds to deployment, and its report."""

import logging
from collections.abc import Callable
from functools import partial, reduce
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from flows.batch.batch_report import MissingReport, WrittenReport, write_report, write_report_of_run
from flows.document.references import Numbers, pinned_shipment, pins
from flows.recount.recount import Asked
from flows.resource.cancel import require_not_canceled
from flows.resource.withdrawal import renew_metadata_here
from flows.stage.cancellation import cancelable_run
from flows.stage.orchestrator import orchestrator
from flows.stage.run_owner import begin_run_in_turn
from flows.stage.stage_summary import recorded_report, run_with_alarm, with_alarm
from flows.stage.stages import (
    Reports,
    deploy,
    export,
    generate,
    judge_batch_stage,
    prepare_simulation,
    robots_in_reserve,
    simulate,
    skip_deployment,
    vouch,
)
from flows.trend.trend_page import write_trend_of_run
from specs.data.run_report import Artefact, PipelineReport
from specs.digest import canonical_document
from specs.errors import ConcurrentDeployment, DocumentError, PipelineNotPassed, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.robomaker.failure_codes import JobFailureCode
from tasks.progress.at_a_time import at_a_time
from tasks.results.gate.shipped_builds import Shipment
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, is_terminal
from tasks.storage.store_url import open_store

logger = logging.getLogger(__name__)


def pipeline(spec: PipelineSpec, store: str | None = None, base: str = ".") -> PipelineReport:
    """Returns the report of a run in which everything passed; see the flow `flows.pipeline.pipeline`."""
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
    asked = Asked(spec, base, versions, worlds, ships)
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
    asked: Asked, batch: JobRecord | None, simulated: Reports, store: Store, run: JobRecord
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
    tested = vouch(spec, batch, asked.worlds, store, asked.versions)
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
