"""The flow `world-generation`: makes worlds from a template."""

from prefect import flow

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.parameter.document_parameter import WorldGenerationParameter
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.stage import generation_stage
from tasks.storage.jobs.records import JobRecord


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
        return completed_job(
            flow_result(lambda: generation_stage.world_generation(spec, store_at(store), base, token), token)
        )
