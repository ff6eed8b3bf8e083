"""The flow `pipeline`: runs a whole document from worlds to deployment, and reports on it."""

from prefect import flow

from flows.deployment_sync import deployment_sync
from flows.entry.flow_state import completed_run
from flows.entry.result_json import result_serializer
from flows.parameter.document_parameter import DocumentParameter
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import Steps, flow_result, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.simulation_batch import simulation_batch
from flows.stage import batch_stage, deployment_stage, export_stage, generation_stage, pipeline_run
from flows.world_export import world_export
from flows.world_generation import world_generation
from specs.data.run_report import PipelineReport

_FLOWS: Steps = {
    generation_stage.world_generation: world_generation,
    export_stage.world_export: world_export,
    batch_stage.simulation_batch: simulation_batch,
    deployment_stage.deployment_sync: deployment_sync,
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
