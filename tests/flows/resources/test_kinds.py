"""Every kind of resource, and every kind of job, is known to the commands."""

from typing import get_args

import pytest
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.cli.shell import app
from flows.resources.abandoned_jobs import job_notes, kind_notes, reap_jobs
from flows.resources.kinds import (
    KINDS,
    cancel_jobs,
    cancel_resource,
    cancel_run,
    describe_jobs,
    describe_resource,
    list_resources,
    require_not_canceled,
)
from specs.arn import Reference, ResourceKind
from specs.errors import ConcurrentDeployment, DocumentError, ResourceNotFound, StageFailed
from specs.job_kinds import JOB_KINDS, JobKind
from specs.robomaker.simulation_descriptions import BatchDescribeSimulationJobResponse
from specs.template.body import template_body, template_digest
from tasks.applications.registry import resolve
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet.reservation import reserve_fleet
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.simulate.batch.batch_record import canceled_jobs
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import leave_queue
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import KIND, begin_run, jobs_of, run_of, stage_token
from tasks.storage.store_url import store_id
from tasks.storage.tags import change_tags, with_tags
from tasks.storage.templates import create_template, keep_body, update_template
from tests.factories.batches import put_worlds
from tests.factories.lively_claims import hold_lively_claim
from tests.factories.planned_batches import begun
from tests.factories.worlds import apartment
from tests.flows.queue.queued_jobs import deployment_request, queue_generation, queue_job


def test_every_kind_of_resource_has_its_commands() -> None:
    assert set(KINDS) == set(get_args(ResourceKind))


def test_every_kind_of_job_is_declared_once_and_can_be_cancelled() -> None:
    assert tuple(JOB_KINDS) == get_args(JobKind)
    assert all(KINDS[kind].load().cancel for kind in JOB_KINDS)
    prefixes = [declared.prefix for declared in JOB_KINDS.values()]
    assert len(set(prefixes)) == len(prefixes)


def test_a_waiting_process_is_told_how_far_each_stage_is() -> None:
    assert all(KINDS[kind].load().progress for kind, declared in JOB_KINDS.items() if declared.stage)


def test_the_help_names_every_kind_and_each_can_be_listed(file_store: Store) -> None:
    said = CliRunner().invoke(app, ["list", "--help"], terminal_width=1000).output
    for kind in KINDS.values():
        assert kind.plural in said
        assert list(kind.load().list(file_store)) == []


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
    with hold_lively_claim(file_store, claim_key("simulation-job-batch", batch.id)):
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


SPEC: dict[str, JsonValue] = {"name": "nightly", "worldGeneration": {}, "worldExport": {"clientRequestToken": "own"}}


def begun_run(store: Store) -> JobRecord:
    with begin_run(store, {"flow": "pipeline", "spec": SPEC}) as run:
        return advance(store, KIND, run.id, "Running")


def job(store: Store, kind: JobKind, token: str, status: str) -> JobRecord:
    return advance(store, kind, submit(store, kind, {}, token).id, status)


def test_a_run_that_nobody_works_on_is_canceled_at_once_with_its_job_and_keeps_what_was_made(file_store: Store) -> None:
    run = begun_run(file_store)
    made = job(file_store, "world-generation-job", stage_token(run, "worlds"), "Completed")
    writing = job(file_store, "world-export-job", "own", "Running")
    cancel_resource(file_store, run.arn)
    assert read(file_store, KIND, run.id).status == "Canceled"
    assert read(file_store, "world-generation-job", made.id).status == "Completed"
    assert read(file_store, "world-export-job", writing.id).status == "Canceled"


def test_whoever_works_on_a_run_is_left_to_end_it(file_store: Store) -> None:
    run = begun_run(file_store)
    with hold_lively_claim(file_store, claim_key(KIND, run.id)):
        assert cancel_run(file_store, run.id).status == "Canceling"
        with pytest.raises(StageFailed, match="Canceled: canceled on request"):
            require_not_canceled(file_store, run)
    assert read(file_store, KIND, run.id).status == "Canceling"
    assert cancel_run(file_store, run.id).status == "Canceled"


def test_a_job_is_cancelled_once(file_store: Store) -> None:
    run = begun_run(file_store)
    writing = job(file_store, "world-export-job", "own", "Running")
    assert cancel_jobs(file_store, run, {writing.id}) == frozenset()
    assert read(file_store, "world-export-job", writing.id).status == "Running"


def test_a_run_that_has_ended_is_not_canceled(file_store: Store) -> None:
    run = begun_run(file_store)
    advance(file_store, KIND, run.id, "Completed")
    with pytest.raises(DocumentError, match="this one is Completed"):
        cancel_resource(file_store, run.arn)


def test_a_run_that_does_not_exist_is_not_found(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        cancel_resource(file_store, "arn:simyard:pipeline-run:0:run-0")


def test_a_canceled_run_is_followed_by_the_next_one(file_store: Store) -> None:
    run = begun_run(file_store)
    cancel_resource(file_store, run.arn)
    assert begun_run(file_store).id != run.id


@pytest.mark.parametrize(
    ("flow", "kind"),
    [
        ("world-generation", "world-generation-job"),
        ("world-export", "world-export-job"),
        ("simulation-batch", "simulation-job-batch"),
        ("deployment-sync", "deployment-job"),
    ],
)
def test_the_job_of_a_stage_that_runs_alone_is_its_runs(file_store: Store, flow: str, kind: JobKind) -> None:
    with begin_run(file_store, {"flow": flow, "spec": {}}) as run:
        token = stage_token(run, flow)
        assert list(jobs_of(run)) == [(kind, submit(file_store, kind, {}, token).id)]
        assert run_of(token) == run.id
    assert run_of("own") == ""


def test_a_queued_job_is_no_abandoned_one(file_store: Store):
    job = queue_generation(file_store, "one")

    assert not [*kind_notes(file_store, "world-generation-jobs")]
    assert not [*job_notes(file_store, job.arn)]
    assert reap_jobs(file_store) == []


def test_a_job_that_has_left_the_queue_and_not_ended_is_one(file_store: Store):
    job = queue_generation(file_store, "one")
    leave_queue(file_store, job.kind, job.id)

    assert [*job_notes(file_store, job.arn)]


def test_a_queued_job_that_is_being_canceled_ends_by_reap_where_no_worker_is(file_store: Store):
    job = queue_generation(file_store, "one")
    advance(file_store, job.kind, job.id, "Canceling")

    assert [each.status for each in reap_jobs(file_store)] == ["Canceled"]


def test_the_next_controller_leaves_a_queued_deployment_its_fleet(file_store: Store):
    create_fleet(file_store, "couriers")
    create_robot(file_store, "r1", "X86_64", {})
    register_robot(file_store, "couriers", "r1")
    request = deployment_request(file_store, "couriers", "queued").model_dump(mode="json", exclude_none=True)
    job = queue_job(file_store, "deployment-job", request, "queued")
    reserve_fleet(file_store, "couriers", job.id)
    other = deployment_request(file_store, "couriers", "other")

    digest, token = resolve(file_store, "robot-application", "courier").digest, "other"

    with pytest.raises(ConcurrentDeployment):
        run_deployment_job(file_store, other, digest=digest, token=token, progress=lambda _done, _total: None)

    assert read(file_store, job.kind, job.id).status == "Pending"
