"""The flow `world-generation`: makes worlds from a template."""

from pathlib import Path

from prefect import flow

from flows.entry.flow_state import completed_job
from flows.entry.result_json import result_serializer
from flows.entry.secret_guard import guarded
from flows.run.cancellation import cancel_with_flow_run
from flows.run.stage_run import require_success, run_name, run_stage
from flows.workers.spread_worlds import world_makers
from specs.arn import arn
from specs.digest import canonical_document
from specs.pipeline.section_requests import generation_request
from specs.pipeline.world_sections import WorldGeneration
from specs.store_reference import StoreReference
from specs.template.body import template_digest
from tasks.documents.template_source import find_template
from tasks.export.task import show_worlds
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.task import generate_worlds


@guarded
@flow(
    name="world-generation",
    flow_run_name=run_name,
    persist_result=True,
    result_serializer=result_serializer(),
    on_cancellation=[cancel_with_flow_run],
)
def world_generation(
    spec: WorldGeneration, store: StoreReference = None, base: str = ".", token: str | None = None
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
    opened = open_store(store)
    makers = world_makers(opened)  # refuses workers that are not installed, before anything is recorded
    template = find_template(spec.template, opened, Path(base))
    digest = template_digest(template)

    def work(given: str) -> JobRecord:
        request = generation_request(spec, template=arn("world-template", store_id(opened), digest), token=given)
        # Only a flow reaches workers: a task would send itself to them, with the store's connections.
        make = generate_worlds.fn if makers else generate_worlds
        record = require_success(
            make(
                opened.url,
                request,
                template,
                seed=spec.seed,
                robot_radius_m=spec.robotRadius,
                token=request.clientRequestToken or given,
                elsewhere=makers,
            )
        )
        show_worlds(opened.url, record)
        return record

    identity = {"spec": canonical_document(spec), "template": digest}
    return completed_job(run_stage(opened, "world-generation", identity, token, work))
