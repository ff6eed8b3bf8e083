"""The stage that writes worlds as files that other programs open."""

from functools import partial

from pydantic import JsonValue

from flows.stage.orchestrator import orchestrator, run_step
from flows.stage.stage_run import require_success, run_stage
from specs.base import Fault
from specs.digest import canonical_document
from specs.errors import DocumentError
from specs.pipeline.section_requests import export_request, reference_arn
from specs.pipeline.world_sections import WorldExport
from tasks.export.step import export_elsewhere, export_worlds
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id


def world_export(
    spec: WorldExport, worlds: list[str] | None = None, store: str | None = None, token: str | None = None
) -> JobRecord:
    """Returns the export job; see the flow `flows.world_export.world_export`."""
    opened = open_store(store)
    writers = orchestrator().world_writers(opened)  # refuses workers that are not installed, before anything begins
    chosen = tuple(worlds or ()) if spec.worlds == "all" else spec.worlds
    if not chosen:
        allowed = (
            "<generation>/<world> of each world, in this parameter or in spec.worlds; a run of this flow alone has none"
        )
        raise DocumentError([Fault(path="worlds", value="none", allowed=allowed)], "parameters")
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
