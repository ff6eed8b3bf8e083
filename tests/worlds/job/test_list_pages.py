"""Worlds, templates and generation jobs are listed in pages, each once, whatever comes and goes between them."""

import pytest
from pydantic import JsonValue

from specs.arn import resource_name
from specs.errors import DocumentError
from specs.robomaker.world_jobs import ListWorldGenerationJobsRequest, ListWorldsRequest, ListWorldTemplatesRequest
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.templates import create_template, keep_body
from tasks.worlds.job.world_answers import list_generation_jobs_page, list_templates_page, list_worlds, list_worlds_page
from tests.worlds.templates import room, template


def generated(store: Store, token: str, worlds: list[str], status: str = "Completed") -> JobRecord:
    """Returns a job that made worlds."""
    template_arn = f"arn:simyard:world-template:0:{token}"
    request: dict[str, JsonValue] = {"template": template_arn, "worldCount": {"floorplanCount": 1}}
    job = submit(store, "world-generation-job", request, token)
    for name in worlds:
        store.put(world_key(job.id, name), b"{}")
    return advance(store, "world-generation-job", job.id, status)


def test_worlds_come_by_job_and_number_and_those_that_somebody_added_last(file_store: Store) -> None:
    old = generated(file_store, "a", ["world-1-10", "world-1-9", "world-2-1"])
    file_store.put(world_key("aardvark", "w"), b"{}")
    new = generated(file_store, "b", ["world-1-1"])
    names = [resource_name(str(world.arn)) for world in list_worlds(file_store)]
    made = [f"{old.id}/world-1-9", f"{old.id}/world-1-10", f"{old.id}/world-2-1", f"{new.id}/world-1-1"]
    assert names == [*made, "aardvark/w"]
    first = list_worlds_page(file_store, ListWorldsRequest(maxResults=2))
    for gone in ("world-1-9", "world-1-10"):
        file_store.delete(world_key(old.id, gone))
    second = list_worlds_page(file_store, ListWorldsRequest(maxResults=100, nextToken=first.nextToken))
    assert [resource_name(str(world.arn)) for world in second.worldSummaries or ()] == [*made[2:], "aardvark/w"]
    assert second.nextToken is None


@pytest.mark.parametrize(
    ("name", "value", "found"), [("status", "Failed", "b"), ("templateId", "a", "a"), ("generationJobId", None, "b")]
)
def test_worlds_are_found_by_their_job(file_store: Store, name: str, value: str | None, found: str) -> None:
    jobs = {"a": generated(file_store, "a", ["w"]), "b": generated(file_store, "b", ["w"], "Failed")}
    asked = {"filters": [{"name": name, "values": [value or jobs[found].id]}]}
    page = list_worlds_page(file_store, ListWorldsRequest.model_validate(asked))
    assert [world.generationJob for world in page.worldSummaries or ()] == [jobs[found].arn]


def test_generation_jobs_are_found_by_status_and_template(file_store: Store) -> None:
    done, failed = generated(file_store, "a", ["w"]), generated(file_store, "b", [], "Failed")
    for name, value, job in (("status", "Completed", done), ("templateId", "b", failed)):
        asked = ListWorldGenerationJobsRequest.model_validate({"filters": [{"name": name, "values": [value]}]})
        page = list_generation_jobs_page(file_store, asked)
        assert [each.arn for each in page.worldGenerationJobSummaries] == [job.arn]


def test_templates_that_somebody_named_come_before_those_of_documents(file_store: Store) -> None:
    named = create_template(file_store, template(room("A")), name="flat")
    digest = keep_body(file_store, template(room("B")))
    first = list_templates_page(file_store, ListWorldTemplatesRequest(maxResults=1))
    second = list_templates_page(file_store, ListWorldTemplatesRequest(maxResults=1, nextToken=first.nextToken))
    shown = [*(first.templateSummaries or ()), *(second.templateSummaries or ())]
    assert [(each.name, resource_name(str(each.arn))) for each in shown] == [("flat", named.id), (digest, digest)]
    assert second.nextToken is None


def test_the_token_of_another_list_is_none(file_store: Store) -> None:
    for number in range(2):
        generated(file_store, str(number), ["w"])
    token = list_worlds_page(file_store, ListWorldsRequest(maxResults=1)).nextToken
    with pytest.raises(DocumentError, match="nextToken"):
        list_generation_jobs_page(file_store, ListWorldGenerationJobsRequest(nextToken=token))
