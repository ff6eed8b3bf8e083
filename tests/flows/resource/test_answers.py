"""`simyard cancel` knows what can be cancelled, and `simyard describe` several jobs at once."""

import pytest

from flows.resources.kinds import cancel_resource, describe_jobs, describe_resource, list_resources
from specs.arn import Reference
from specs.errors import DocumentError, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.simulation_descriptions import BatchDescribeSimulationJobResponse
from specs.template.body import template_body, template_digest
from tasks.deploy.fleet.fleet_registry import create_robot
from tasks.simulate.batch.batch_record import canceled_jobs
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import read, submit
from tasks.storage.store_url import store_id
from tasks.storage.tags import change_tags, with_tags
from tasks.storage.templates import create_template, keep_body, update_template
from tests.factories.batches import put_worlds
from tests.factories.planned_batches import begun
from tests.factories.worlds import apartment


@pytest.mark.parametrize("text", ["arn:simyard:world:0:g/w", "arn:simyard:robot:0:r2", "r2"])
def test_what_is_never_cancelled_is_refused(file_store: Store, text: str):
    put_worlds(file_store, {"g/w": apartment()})
    create_robot(file_store, "r2")
    with pytest.raises(DocumentError, match=r"a simulation-job or a world-generation-job or .*; this is a"):
        cancel_resource(file_store, text)


@pytest.mark.parametrize("text", ["simb-1", "arn:simyard:planet:0:mars", "nonsense"])
def test_what_names_nothing_is_not_cancelled(file_store: Store, text: str):
    with pytest.raises(DocumentError, match=r"not in the store|names no kind of resource"):
        cancel_resource(file_store, text)


def test_bare_ids_and_names_do_for_describe_and_cancel(file_store: Store):
    batch, robot = begun(file_store), create_robot(file_store, "r2")
    assert describe_resource(file_store, batch.id) == describe_resource(file_store, batch.record().arn)
    assert describe_resource(file_store, f"{batch.id}/0").model_dump()["name"] == f"{batch.id}-0"
    assert describe_resource(file_store, robot.name).model_dump()["name"] == "r2"
    cancel_resource(file_store, f"{batch.id}/0")
    assert canceled_jobs(batch.record()) == {0}
    cancel_resource(file_store, batch.id)
    assert batch.record().status == "Canceled"


def test_a_batch_that_does_not_exist_is_not_cancelled(file_store: Store):
    with pytest.raises(ResourceNotFound):
        cancel_resource(file_store, "arn:simyard:simulation-job-batch:0:simb-0")


def test_an_old_arn_of_robomaker_means_the_batch_of_that_name(file_store: Store):
    batch = begun(file_store)
    with hold_claim(file_store, claim_key("simulation-job-batch", batch.id), ttl_s=1.5):
        cancel_resource(file_store, f"arn:aws:robomaker:us-east-1:111111111111:simulation-job-batch/{batch.id}")
    assert batch.record().status == "Canceling"


def test_several_jobs_are_described_at_once_and_those_that_are_not_there_are_named(file_store: Store):
    job = begun(file_store).record().arn.replace("simulation-job-batch", "simulation-job")
    asked = [f"{job}/5", f"{job}/6", f"{job}/0"]
    answer = describe_jobs(file_store, asked)
    assert isinstance(answer, BatchDescribeSimulationJobResponse)
    assert [each.arn for each in answer.jobs or ()] == [asked[0], asked[2]]
    assert answer.unprocessedJobs == (asked[1],)


def test_several_jobs_are_described_with_the_tags_of_now(file_store: Store):
    batch = begun(file_store)
    change_tags(file_store, Reference(kind="simulation-job", path=f"{batch.id}/0"), dict, with_tags({"shift": "night"}))
    answer = describe_jobs(file_store, [batch.record().arn.replace("simulation-job-batch", "simulation-job") + "/0"])
    assert isinstance(answer, BatchDescribeSimulationJobResponse)
    assert [each.tags for each in answer.jobs or ()] == [{"shift": "night"}]


@pytest.mark.parametrize("arns", [["arn:x"] * 101, ["arn:x", "job"]])
def test_a_hundred_arns_are_described_at_once_at_most(file_store: Store, arns: list[str]):
    with pytest.raises(DocumentError, match="jobs"):
        describe_jobs(file_store, arns)


@pytest.mark.parametrize("kind", ["world-generation-job", "world-export-job"])
def test_a_job_that_makes_or_writes_worlds_is_cancelled(file_store: Store, kind: JobKind):
    record = submit(file_store, kind, {}, "one")
    cancel_resource(file_store, record.arn)
    assert read(file_store, kind, record.id).status == "Canceled"


def test_a_deployment_is_cancelled(file_store: Store):
    record = submit(file_store, "deployment-job", {}, "one")
    cancel_resource(file_store, record.arn)
    assert read(file_store, "deployment-job", record.id).status == "Canceled"


def test_a_world_that_somebody_added_is_listed_and_described_without_a_job(file_store: Store):
    put_worlds(file_store, {"shrunk/small": apartment()})
    arn = f"arn:simyard:world:{store_id(file_store)}:shrunk/small"
    file_store.put("worlds/shrunk/contact-sheet.svg", b"<svg/>")
    assert [each.model_dump(exclude_none=True) for each in list_resources(file_store, "worlds")] == [{"arn": arn}]
    assert describe_resource(file_store, arn).model_dump(exclude_none=True) == {"arn": arn}


def test_a_world_of_a_job_that_goes_on_is_not_taken_for_an_added_one(file_store: Store):
    job = submit(file_store, "world-generation-job", {}, "one")
    put_worlds(file_store, {f"{job.id}/world-1-1": apartment()})
    (world,) = list_resources(file_store, "worlds")
    assert world.model_dump()["generationJob"] == job.arn


def test_what_was_tagged_later_is_described(file_store: Store):
    record = submit(file_store, "world-export-job", {"worlds": ["arn:simyard:world:s:g/w"], "tags": {"a": "b"}}, "t")
    job = Reference(kind="world-export-job", path=record.id)
    change_tags(file_store, job, lambda: {"a": "b"}, with_tags({"c": "d"}))
    assert describe_resource(file_store, record.id).model_dump()["tags"] == {"a": "b", "c": "d"}


def test_templates_that_somebody_named_are_listed_before_what_worlds_were_made_from(file_store: Store):
    first, second = (template_body({"Version": version, "Buildings": [{"Floors": [{}]}]}) for version in ("1", "2"))
    named = create_template(file_store, first, name="a flat")
    update_template(file_store, named.id, body=second)
    other = template_body({"Buildings": [{"Floors": [{"Floorplan": {"Ceiling": {"Height": 3.5}}}]}]})
    keep_body(file_store, other)
    listed = [each.model_dump()["name"] for each in list_resources(file_store, "world-templates")]
    assert listed == ["a flat", template_digest(other)]
    assert describe_resource(file_store, "a flat").model_dump()["version"] == "2"
