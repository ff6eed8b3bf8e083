"""Simyard's flows as Prefect has them: the pipeline, each of its stages alone, and reaping."""

import logging

from prefect import flow
from prefect.artifacts import create_table_artifact

from flows.pipeline import pipeline_run, stages
from flows.prefect.flow_calls import completed_job, completed_reaping, completed_run, result_serializer
from flows.prefect.flow_runs import cancel_with_flow_run, end_abandoned_flow_runs
from flows.prefect.parameters import (
    DeploymentParameter,
    DocumentParameter,
    SimulationBatchParameter,
    StoreParameter,
    WorldExportParameter,
    WorldGenerationParameter,
    guarded,
    store_at,
)
from flows.prefect.prefect_events import announce_changes
from flows.prefect.prefect_orchestrator import Steps, flow_result, run_name, under_prefect
from flows.resources.abandoned_jobs import ReapedJob
from flows.resources.abandoned_jobs import reap_jobs as reap_store
from flows.resources.fleet_membership import renew_metadata_here
from specs.data.run_report import PipelineReport
from specs.field_types import Architecture
from specs.pipeline.gate_section import Gate
from specs.untrusted_text import table_rows
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store


@guarded
@flow(
    name="world-generation",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def world_generation(
    spec: WorldGenerationParameter, store: StoreParameter = None, base: str = ".", token: str | None = None
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
    with under_prefect():
        return completed_job(flow_result(lambda: stages.world_generation(spec, store_at(store), base, token), token))


@guarded
@flow(
    name="world-export",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def world_export(
    spec: WorldExportParameter, worlds: list[str] | None = None, store: StoreParameter = None, token: str | None = None
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
    with under_prefect():
        return completed_job(flow_result(lambda: stages.world_export(spec, worlds, store_at(store), token), token))


@guarded
@flow(
    name="simulation-batch",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def simulation_batch(
    spec: SimulationBatchParameter,
    worlds: list[str] | None = None,
    store: StoreParameter = None,
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
    with under_prefect():
        return completed_job(
            flow_result(
                lambda: stages.simulation_batch(spec, worlds, store_at(store), versions, token, gate=gate), token
            )
        )


@guarded
@flow(
    name="deployment-sync",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def deployment_sync(
    spec: DeploymentParameter,
    store: StoreParameter = None,
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
    with under_prefect():
        return completed_job(
            flow_result(
                lambda: stages.deployment_sync(spec, store_at(store), tested, versions, token, builds=builds),
                token,
            )
        )


_FLOWS: Steps = {
    stages.world_generation: world_generation,
    stages.world_export: world_export,
    stages.simulation_batch: simulation_batch,
    stages.deployment_sync: deployment_sync,
}
# Without results of their own: where somebody has an ended flow run retried, Prefect would take each stage that has one
# for done, and the document's next run would have the jobs of the one before.
_STAGES: Steps = {stage: each.with_options(persist_result=False) for stage, each in _FLOWS.items()}


@guarded
@flow(
    name="pipeline",
    flow_run_name="{spec.name}",
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def pipeline(spec: DocumentParameter, store: StoreParameter = None, base: str = ".") -> PipelineReport:
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
    with under_prefect(_STAGES):
        return completed_run(flow_result(lambda: pipeline_run.pipeline(spec, store_at(store), base)))


_LOG = logging.getLogger(__name__)


@guarded
@flow(name="reaping", persist_result=True, result_serializer=result_serializer())
def reaping(store: StoreParameter = None) -> list[ReapedJob]:
    """Returns the abandoned jobs that were found, and leaves a table of them; see `simyard reap`.

    The flow runs that worked on abandoned runs become Crashed. What the keys in SIMYARD_KEYS have signed is signed
    anew in the second half of its time.

    Args:
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.

    Raises:
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
    """
    opened = open_store(store_at(store))
    with announce_changes():
        found = reap_store(opened)
        for flow_run in end_abandoned_flow_runs(opened):
            _LOG.info(
                "flow run %s had no process any more and is Crashed, or Cancelled if somebody asked for it", flow_run
            )
        for line in renew_metadata_here(opened):
            _LOG.warning("%s: simyard fleet keys renew, with its key", line)
    if found:
        rows = table_rows(each.model_dump(mode="json") for each in found)
        create_table_artifact(rows, key="reaped", description=f"{len(found)} jobs that nobody worked on")
    return completed_reaping(found)
