"""The stage that makes worlds from a template."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from flows.stage.orchestrator import orchestrator, run_step
from flows.stage.stage_run import require_success, run_stage
from flows.stage.stage_summary import JOBS
from specs.arn import arn
from specs.digest import canonical_document
from specs.pipeline.generation_parts import GenerationPart
from specs.pipeline.section_requests import generation_request, section_parts
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

    make = partial(run_step, generate_worlds)
    if makers:  # they show a task run for each piece; one around them would hold what cannot be sent
        make = partial(generate_elsewhere, elsewhere=makers)

    def work_part(given: str, part: GenerationPart) -> JobRecord:
        request = generation_request(spec, part, template=arn("world-template", store_id(opened), digest), token=given)
        record = make(
            opened.url,
            request,
            template,
            seed=spec.seed,
            token=request.clientRequestToken or given,
            robot_radius_m=spec.robotRadius,
            first=part.first,
        )
        run_step(draw_worlds, opened.url, require_success(record))
        return record

    def work(given: str) -> JobRecord:
        return joined([work_part(given, part) for part in section_parts(spec)])

    identity = {"spec": canonical_document(spec), "template": digest}
    return run_stage(opened, "world-generation", identity, token, work)


def joined(jobs: Sequence[JobRecord]) -> JobRecord:
    """Returns the first of a section's generation jobs, with the worlds and the failures of all of them.

    The store keeps each job as it is; what they are together is nowhere but in the run.

    Args:
        jobs: Ended ones, in order, at least one.
    """
    first, *more = jobs
    if not more:
        return first
    failures: dict[str, JsonValue] = {}
    for job in jobs:
        for code, each in cast("Mapping[str, Mapping[str, JsonValue]]", job.detail["failures"]).items():
            known = cast("Mapping[str, JsonValue]", failures.get(code, {"count": 0, **each} | {"count": 0}))
            failures[code] = {**known, "count": cast("int", known["count"]) + cast("int", each["count"])}
    worlds: list[JsonValue] = [world for job in jobs for world in cast("list[JsonValue]", job.detail["worlds"])]
    detail = {**first.detail, "worlds": worlds, "failures": failures, JOBS: [job.id for job in jobs]}
    return first.model_copy(update={"detail": detail, "status": "PartialFailed" if failures else first.status})
