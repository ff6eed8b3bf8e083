"""The flow `world-export`: writes worlds as files that other programs open."""

from prefect import flow
from pydantic import JsonValue

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.entry.secret_guard import guarded
from flows.run.cancellation import cancel_with_flow_run
from flows.run.stage_run import require_success, run_name, run_stage
from flows.workers.spread_worlds import world_writers
from specs.digest import canonical_document
from specs.pipeline.section_requests import export_request, reference_arn
from specs.pipeline.world_sections import WorldExport
from specs.store_reference import StoreReference
from tasks.export.task import export_worlds
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id


@guarded
@flow(
    name="world-export",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def world_export(
    spec: WorldExport, worlds: list[str] | None = None, store: StoreReference = None, token: str | None = None
) -> JobRecord:
    """Returns the export job, whose ``detail["zip"]`` says where the worlds lie.

    Args:
        spec: The pipeline's section ``worldExport``.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means.
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
        token: Given by the pipeline; None makes this a run of its own.

    Raises:
        StageFailed: The worlds could not be read or written; carries RoboMaker's code.
    """
    opened = open_store(store)
    writers = world_writers(opened)  # refuses workers that are not installed, before anything is recorded
    chosen = tuple(worlds or ()) if spec.worlds == "all" else spec.worlds
    references = [reference_arn("world", world, store_id(opened)) for world in chosen]

    def work(given: str) -> JobRecord:
        request = export_request(spec, worlds=references, token=given)
        job_token = request.clientRequestToken or given
        # Only a flow reaches workers: a task would send itself to them, with the store's connections.
        write = export_worlds.fn if writers else export_worlds
        return require_success(write(opened.url, request, formats=spec.formats, token=job_token, elsewhere=writers))

    identity: dict[str, JsonValue] = {"spec": canonical_document(spec), "worlds": [*chosen]}
    return completed_job(run_stage(opened, "world-export", identity, token, work))
