"""The flow `world-export`: writes worlds as files that other programs open."""

from prefect import flow

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.parameter.document_parameter import WorldExportParameter
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import flow_result, run_name, under_prefect
from flows.run.cancellation import cancel_with_flow_run
from flows.stage import export_stage
from tasks.storage.jobs.records import JobRecord


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
        return completed_job(
            flow_result(lambda: export_stage.world_export(spec, worlds, store_at(store), token), token)
        )
