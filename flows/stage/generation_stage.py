"""The stage that makes worlds from a template."""

from functools import partial
from pathlib import Path

from flows.stage.orchestrator import orchestrator, run_step
from flows.stage.stage_run import require_success, run_stage
from specs.arn import arn
from specs.digest import canonical_document
from specs.pipeline.section_requests import generation_request
from specs.pipeline.world_sections import WorldGeneration
from specs.template.body import template_digest
from tasks.documents.template_source import find_template
from tasks.export.step import draw_worlds
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.step import generate_elsewhere, generate_worlds


def world_generation(
    spec: WorldGeneration, store: str | None = None, base: str = ".", token: str | None = None
) -> JobRecord:
    """Returns the generation job; see the flow `flows.world_generation.world_generation`."""
    opened = open_store(store)
    makers = orchestrator().world_makers(opened)  # refuses workers that are not installed, before anything is recorded
    template = find_template(spec.template, opened, Path(base))
    digest = template_digest(template)

    def work(given: str) -> JobRecord:
        request = generation_request(spec, template=arn("world-template", store_id(opened), digest), token=given)
        job_token = request.clientRequestToken or given
        make = partial(run_step, generate_worlds)
        if makers:  # they show a task run for each piece; one around them would hold what cannot be sent
            make = partial(generate_elsewhere, elsewhere=makers)
        record = make(opened.url, request, template, seed=spec.seed, token=job_token, robot_radius_m=spec.robotRadius)
        run_step(draw_worlds, opened.url, require_success(record))
        return record

    identity = {"spec": canonical_document(spec), "template": digest}
    return run_stage(opened, "world-generation", identity, token, work)
