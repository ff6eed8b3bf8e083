"""A resource is found by its ARN, by RoboMaker's old one, and by its bare id or name."""

import pytest

from specs.arn import KINDS, ArnForm, arn
from specs.errors import DocumentError, ResourceNotFound
from specs.template.body import template_body
from tasks.storage.base.keys import application_key, fleet_key, robot_record_key, template_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import submit
from tasks.storage.jobs.runs import stage_token
from tasks.storage.resource_names import find_batch_name, find_resource, resource_arn
from tasks.storage.store_url import store_id
from tasks.storage.templates import create_template

BATCH = "simulation-job-batch"


def found(store: Store, text: str) -> tuple[str | None, str]:
    return find_resource(store, text, KINDS)


@pytest.mark.parametrize(
    ("kind", "key", "name"),
    [
        ("world-template", template_key("flat"), "flat"),
        ("world", world_key("mine", "w"), "mine/w"),
        ("robot-application", application_key("robot-application", "guide"), "guide"),
        ("simulation-application", application_key("simulation-application", "rooms"), "rooms"),
        ("deployment-fleet", fleet_key("guides"), "guides"),
        ("robot", robot_record_key("r1"), "r1"),
    ],
)
def test_what_has_a_name_is_found_by_it_and_by_its_arn(file_store: Store, kind: str, key: str, name: str):
    file_store.put(key, b"{}")
    assert found(file_store, name) == (kind, name)
    assert found(file_store, f"arn:simyard:{kind}:0:{name}") == (kind, name)


def test_a_job_is_found_by_its_id_its_arn_and_by_an_old_arn_of_robomaker(file_store: Store):
    record = submit(file_store, BATCH, {}, "one")
    old = f"arn:aws:robomaker:us-east-1:111111111111:{BATCH}/{record.id}"
    for text in (record.id, record.arn, old):
        assert found(file_store, text) == (BATCH, record.id)
    assert found(file_store, f"{record.id}/3") == ("simulation-job", f"{record.id}/3")


def test_a_batch_and_its_jobs_are_found_by_the_names_that_robomakers_clients_see(file_store: Store):
    record = submit(file_store, BATCH, {}, "one")
    digits = record.id.partition("-")[2]
    form = ArnForm("another-store", "eu-west-1")
    job = form.robomakers(arn("simulation-job", "x", f"{record.id}/3"))
    for text in (f"sim-{digits}3", job):
        assert found(file_store, text) == ("simulation-job", f"{record.id}/3")
    for text in (f"sjb-{digits}", form.robomakers(record.arn)):
        assert found(file_store, text) == (BATCH, record.id)


def test_a_cut_id_is_not_found_and_the_whole_one_is_told(file_store: Store):
    record = submit(file_store, BATCH, {}, "one")
    with pytest.raises(ResourceNotFound, match=rf"simulation-job-batch: .*not in the store .*near it: {record.id}"):
        find_resource(file_store, record.id[:9], KINDS)
    with pytest.raises(ResourceNotFound, match=rf"simulation-job: .*near it: {record.id}/7"):
        find_resource(file_store, f"{record.id[:-1]}/7", KINDS)


def test_a_misspelt_name_is_not_found_and_the_right_one_is_told(file_store: Store):
    file_store.put(fleet_key("night-guides"), b"{}")
    file_store.put(fleet_key("cranes"), b"{}")
    with pytest.raises(ResourceNotFound, match=r"not in the store .*near it: night-guides; simyard list"):
        find_resource(file_store, "nigth-guides", KINDS)


def test_the_message_says_which_list_shows_what_is_there(file_store: Store):
    with pytest.raises(ResourceNotFound, match=r"deployment-job: 'dep-0': not in the store .*simyard list deployment"):
        find_resource(file_store, "arn:simyard:deployment-job:0:dep-0", KINDS)


def test_a_name_of_two_things_is_refused_with_the_arn_of_each(file_store: Store):
    file_store.put(fleet_key("dock"), b"{}")
    file_store.put(template_key("dock"), b"{}")
    with pytest.raises(DocumentError, match=r"arn:simyard:world-template:\w+:dock.*arn:simyard:deployment-fleet:\w+:d"):
        find_resource(file_store, "dock", KINDS)
    assert find_resource(file_store, "dock", ["deployment-fleet"]).kind == "deployment-fleet"


@pytest.mark.parametrize("text", ["", "a b", "../x", "x/../y", "a/b/c", "-x"])
def test_what_no_name_can_be_is_not_found(file_store: Store, text: str):
    with pytest.raises(ResourceNotFound, match="not in the store"):
        find_resource(file_store, text, KINDS)


def test_another_kind_than_the_wanted_one_is_told(file_store: Store):
    record = submit(file_store, BATCH, {}, "one")
    for text in (record.id, record.arn):
        with pytest.raises(DocumentError, match=rf"a simulation-job, such as {record.id}/0; this is a simulation-job-"):
            find_resource(file_store, text, ["simulation-job"])


def test_a_batch_is_found_by_a_job_of_it_and_by_the_run_of_its_document(file_store: Store):
    run = submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": {"simulationBatch": {}}}, "one")
    batch = submit(file_store, BATCH, {}, stage_token(run, "batch"))
    for text in (batch.id, batch.arn, f"{batch.id}/0", run.id, run.arn):
        assert find_batch_name(file_store, text) == batch.id


def test_a_run_of_a_document_without_a_batch_has_none(file_store: Store):
    run = submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": {"deployment": {}}}, "one")
    with pytest.raises(DocumentError, match="a run with a simulationBatch"):
        find_batch_name(file_store, run.id)


def test_the_arn_of_a_name_is_that_of_what_the_store_has(file_store: Store):
    file_store.put(fleet_key("dock"), b"{}")
    arn = f"arn:simyard:deployment-fleet:{store_id(file_store)}:dock"
    assert (resource_arn(file_store, "dock"), resource_arn(file_store, arn)) == (arn, arn)
    with pytest.raises(DocumentError, match="planet"):
        resource_arn(file_store, "arn:simyard:planet:0:mars")


def test_a_template_that_somebody_named_is_found_by_its_name_and_its_id(file_store: Store):
    named = create_template(file_store, template_body({"Buildings": [{"Floors": [{}]}]}), name="a small flat")
    for text in ("a small flat", named.id, f"arn:simyard:world-template:0:{named.id}"):
        assert found(file_store, text) == ("world-template", named.id)


def test_a_template_of_the_name_of_a_robot_is_told_apart_by_its_arn(file_store: Store):
    named = create_template(file_store, template_body({"Buildings": [{"Floors": [{}]}]}), name="r1")
    file_store.put(robot_record_key("r1"), b"{}")
    with pytest.raises(DocumentError, match=named.id):
        found(file_store, "r1")
    assert find_resource(file_store, "r1", ["robot"]) == ("robot", "r1")
