"""The flow `world-generation`: makes worlds from a template."""

from prefect import flow

from flows.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.stage import generation_stage
from specs.pipeline.world_sections import WorldGeneration
from tasks.storage.jobs.records import JobRecord


@flow(name="world-generation", flow_run_name=run_name, persist_result=False, on_cancellation=[cancel_with_flow_run])
def world_generation(
    spec: WorldGeneration, store: str | None = None, base: str = ".", token: str | None = None
) -> JobRecord:
    """Returns the generation job, whose ``detail["worlds"]`` names the worlds.

    Args:
        spec: The pipeline's section ``worldGeneration``.
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
        base: Folder that a template's relative path starts from.
        token: Given by the pipeline; None makes this a run of its own.

    Raises:
        StageFailed: No world could be made.
        DocumentError: The template is missing or none.
    """
    with under_prefect():
        return flow_result(lambda: generation_stage.world_generation(spec, store, base, token), token)
