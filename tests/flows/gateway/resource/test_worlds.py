"""Calls about worlds."""

from typing import cast

import pytest
from pydantic import JsonValue

from specs.base import canonical_document, canonical_json
from specs.errors import ResourceNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.keys import tags_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import jobs_of
from tasks.worlds.job.stored_worlds import delete_worlds
from tasks.worlds.job.world_answers import list_worlds
from tests.factories.worlds import apartment
from tests.flows.gateway.jobs.asked import Asked

TEMPLATE = f"arn:simyard:world-template:s:{'0' * 64}"
COUNT: JsonValue = {"floorplanCount": 1}


def generation(store: Store, *names: str, status: str = "Completed", tags: JsonValue = None) -> JobRecord:
    """Returns a generation job that made worlds of these names."""
    request: dict[str, JsonValue] = {"template": TEMPLATE, "worldCount": COUNT, "templateDigest": "0" * 64}
    record = submit(store, "world-generation-job", {**request, **({"worldTags": tags} if tags else {})}, "t")
    for name in names:
        made = apartment(generation=record.id, name=name)
        store.put(world_key(record.id, name), canonical_json(canonical_document(made)))
    worlds = cast("JsonValue", [f"{record.id}/{name}" for name in names])
    return advance(store, "world-generation-job", record.id, status, detail={"worlds": worlds})


def under_way(store: Store, kind: JobKind, request: dict[str, JsonValue]) -> JobRecord:
    """Returns a job that has not ended."""
    return submit(store, kind, request, "under way")


def test_a_world_has_the_tags_of_its_job_and_those_that_came_later(gateway: Asked) -> None:
    job = generation(gateway.store, "w", tags={"floor": "oak"})
    world = gateway.arn("world", f"{job.id}/w")
    assert gateway.call("DescribeWorld", world=world)["tags"] == {"floor": "oak"}
    gateway.call("TagResource", resourceArn=world, tags={"kitchen": "small"})
    described = gateway.call("DescribeWorld", world=world)
    assert described["tags"] == {"floor": "oak", "kitchen": "small"}
    assert (described["generationJob"], described["template"]) == (job.arn, TEMPLATE)


def test_a_world_that_is_not_there_is_not_found(gateway: Asked) -> None:
    with pytest.raises(ResourceNotFound):
        gateway.call("DescribeWorld", world=gateway.arn("world", "wgj-1/w"))


def test_deleted_worlds_are_gone_with_their_tags(gateway: Asked) -> None:
    job = generation(gateway.store, "a", "b")
    first, second = (gateway.arn("world", f"{job.id}/{name}") for name in "ab")
    gateway.call("TagResource", resourceArn=first, tags={"kitchen": "small"})
    assert gateway.call("BatchDeleteWorlds", worlds=[first, first]) == {}
    with pytest.raises(ResourceNotFound):
        gateway.call("DescribeWorld", world=first)
    assert not gateway.store.exists(tags_key("world", f"{job.id}/a"))
    assert [each.arn for each in list_worlds(gateway.store)] == [second]


def test_what_its_job_says_of_a_deleted_world_stays(gateway: Asked) -> None:
    job = generation(gateway.store, "a")
    world = gateway.arn("world", f"{job.id}/a")
    gateway.call("BatchDeleteWorlds", worlds=[world])
    summary = gateway.call("DescribeWorldGenerationJob", job=job.arn)["finishedWorldsSummary"]
    assert summary["succeededWorlds"] == [world]


def test_what_is_no_world_that_is_there_is_left_over(gateway: Asked) -> None:
    job = generation(gateway.store, "a")
    good = gateway.arn("world", f"{job.id}/a")
    bad = [gateway.arn("world", f"{job.id}/b"), gateway.arn("world", "one part"), job.arn, "arn:nothing"]
    left = gateway.call("BatchDeleteWorlds", worlds=[bad[0], good, *bad[1:]])["unprocessedWorlds"]
    assert sorted(left) == sorted(bad)
    assert not gateway.store.exists(world_key(job.id, "a"))


@pytest.mark.parametrize("kind", ["simulation-job-batch", "world-export-job"])
def test_a_world_that_a_job_under_way_needs_stays(gateway: Asked, kind: JobKind) -> None:
    store = gateway.store
    job = generation(store, "a", "b")
    world, reference = gateway.arn("world", f"{job.id}/a"), f"{job.id}/a"
    plan: JsonValue = {"world_digests": {reference: "0" * 64}}
    user = under_way(store, kind, {"plan": plan} if kind == "simulation-job-batch" else {"worlds": [world]})
    other = gateway.arn("world", f"{job.id}/b")
    assert gateway.call("BatchDeleteWorlds", worlds=[world, other]) == {"unprocessedWorlds": [world]}
    advance(store, kind, user.id, "Failed")
    assert gateway.call("BatchDeleteWorlds", worlds=[world]) == {}


def test_a_world_whose_own_job_is_under_way_stays(gateway: Asked) -> None:
    job = generation(gateway.store, "a", status="Running")
    world = gateway.arn("world", f"{job.id}/a")
    assert gateway.call("BatchDeleteWorlds", worlds=[world]) == {"unprocessedWorlds": [world]}


def test_a_world_that_a_job_names_at_that_very_moment_is_put_back(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = generation(file_store, "a")
    delete = file_store.delete
    body = file_store.get(world_key(job.id, "a")).body

    def begin_then_delete(key: str) -> None:
        monkeypatch.undo()
        under_way(file_store, "world-export-job", {"worlds": [f"{job.id}/a"]})
        delete(key)

    monkeypatch.setattr(file_store, "delete", begin_then_delete)
    assert delete_worlds(file_store, [f"{job.id}/a"]) == [f"{job.id}/a"]
    assert file_store.get(world_key(job.id, "a")).body == body


def test_a_world_of_a_document_that_is_run_stays_until_the_run_has_ended(file_store: Store) -> None:
    request: dict[str, JsonValue] = {"flow": "pipeline", "spec": {"name": "night", "worldGeneration": {}}}
    run = submit(file_store, "pipeline-run", request, "run-token")
    ((_, made),) = jobs_of(run)
    file_store.put(world_key(made, "w"), b"world")
    assert delete_worlds(file_store, [f"{made}/w"]) == [f"{made}/w"]
    advance(file_store, "pipeline-run", run.id, "Failed")
    assert delete_worlds(file_store, [f"{made}/w"]) == []
