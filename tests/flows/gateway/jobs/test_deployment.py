"""Deployment jobs: asked for, described, cancelled; and syncs."""

import pytest

from specs.errors import (
    ConcurrentDeployment,
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceNotFound,
)
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet.fleet_registry import read_fleet
from tasks.deploy.fleet.reservation import delete_fleet
from tasks.deploy.rollout.job import run_deployment_job
from tasks.deploy.rollout.operator_commands import wish_of
from tasks.storage.base.keys import job_key
from tasks.storage.jobs.queue import is_queued, leave_queue, queued_jobs
from tasks.storage.jobs.records import advance, read
from tests.factories.gateway.old_records import fail_with_code
from tests.flows.gateway.jobs.asked import Asked, path

KIND = "deployment-job"


def test_a_deployment_is_recorded_and_queued_and_has_its_fleet(asked: Asked):
    request = asked.deployment_request(asked.fleet(), tags={"team": "blue"})
    made = asked.call("CreateDeploymentJob", **request)
    assert {name: made[name] for name in request if name != "clientRequestToken"} == {
        name: value for name, value in request.items() if name != "clientRequestToken"
    }
    assert made["status"] == "Pending"
    assert is_queued(asked.store, KIND, path(made))
    assert read_fleet(asked.store, "team")[0].deployment == path(made)
    assert asked.call("CreateDeploymentJob", **request) == made
    assert asked.call("DescribeDeploymentJob", job=made["arn"])["fleet"] == request["fleet"]


def test_a_fleet_takes_no_second_deployment_before_a_worker_has_seen_the_first(asked: Asked):
    fleet = asked.fleet()
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(fleet))
    with pytest.raises(ConcurrentDeployment, match=path(made)):
        asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "d2"))
    with pytest.raises(ConcurrentDeployment):
        asked.call("SyncDeploymentJob", clientRequestToken="s", fleet=fleet)
    with pytest.raises(ConcurrentDeployment):
        delete_fleet(asked.store, "team")
    assert [entry.id for entry in queued_jobs(asked.store)] == [path(made)]


def test_a_document_cancels_no_deployment_that_waits_for_a_worker(asked: Asked):
    fleet = asked.fleet()
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(fleet))
    request = CreateDeploymentJobRequest.model_validate(asked.deployment_request(fleet, "d2"))
    with pytest.raises(ConcurrentDeployment):
        run_deployment_job(
            asked.store, request, digest=asked.digest(), token=request.clientRequestToken, progress=lambda *_: None
        )
    assert read(asked.store, KIND, path(made)).status == "Pending"


def test_a_fleet_whose_gateway_died_before_the_record_is_busy_while_the_job_is_queued(asked: Asked):
    fleet = asked.fleet()
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(fleet))
    asked.store.delete(job_key(KIND, path(made)))
    with pytest.raises(ConcurrentDeployment):
        asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "d2"))
    leave_queue(asked.store, KIND, path(made))
    assert asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "d2"))["status"] == "Pending"


def test_a_token_comes_back_after_the_fleet_was_busy(asked: Asked):
    fleet = asked.fleet()
    first = asked.call("CreateDeploymentJob", **asked.deployment_request(fleet))
    with pytest.raises(ConcurrentDeployment):
        asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "d2"))
    advance(asked.store, KIND, path(first), "Succeeded")
    assert asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "d2"))["status"] == "Pending"


def test_a_sync_is_a_job_of_its_own_and_its_entry_says_what_it_is(asked: Asked):
    fleet = asked.fleet()
    asked.deployed("team", "d1")
    made = asked.call("SyncDeploymentJob", clientRequestToken="s1", fleet=fleet)
    assert (made["status"], made["fleet"]) == ("Pending", fleet)
    (entry,) = queued_jobs(asked.store)
    assert (entry.id, entry.options) == (path(made), {"sync": True})
    assert asked.call("SyncDeploymentJob", clientRequestToken="s1", fleet=fleet) == made
    leave_queue(asked.store, KIND, path(made))
    asked.call("CancelDeploymentJob", job=made["arn"])
    assert [entry.options for entry in queued_jobs(asked.store)] == [{"sync": True}]


def test_a_token_of_a_sync_is_no_deployments_and_no_other_fleets(asked: Asked):
    fleet, other = asked.fleet(), asked.fleet("others")
    asked.deployed("team", "d1")
    made = asked.call("SyncDeploymentJob", clientRequestToken="s1", fleet=fleet)
    advance(asked.store, KIND, path(made), "Succeeded")
    with pytest.raises(IdempotentParameterMismatch):
        asked.call("CreateDeploymentJob", **asked.deployment_request(fleet, "s1"))
    with pytest.raises(IdempotentParameterMismatch):
        asked.call("SyncDeploymentJob", clientRequestToken="s1", fleet=other)
    with pytest.raises(IdempotentParameterMismatch):
        asked.call("SyncDeploymentJob", clientRequestToken="d1", fleet=fleet)


def test_a_fleet_without_a_deployment_has_nothing_to_sync(asked: Asked):
    with pytest.raises(ResourceNotFound):
        asked.call("SyncDeploymentJob", clientRequestToken="s", fleet=asked.fleet())
    assert queued_jobs(asked.store) == []


def test_a_cancelled_deployment_is_left_to_its_worker(asked: Asked):
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    for _ in range(2):
        assert asked.call("CancelDeploymentJob", job=made["arn"]) == {}
    assert wish_of(asked.store, path(made)) == "cancel"
    advance(asked.store, KIND, path(made), "Succeeded")
    asked.fleet("others")
    other = asked.deployed("others", "d3")
    with pytest.raises(DocumentError, match="Succeeded"):
        asked.call("CancelDeploymentJob", job=other)


def test_a_deployment_too_many_leaves_its_fleet_free(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_DEPLOYMENTS", "1")
    asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    other = asked.fleet("others")
    with pytest.raises(LimitExceeded):
        asked.call("CreateDeploymentJob", **asked.deployment_request(other, "d2"))
    assert read_fleet(asked.store, "others")[0].deployment == ""


@pytest.mark.parametrize("lacking", ["fleet", "application", "version"])
def test_what_a_deployment_needs_and_is_not_there_is_not_found(lacking: str, asked: Asked):
    request = asked.deployment_request(asked.fleet())
    (use,) = request["deploymentApplicationConfigs"]
    if lacking == "fleet":
        request["fleet"] = asked.arn("deployment-fleet", "none")
    elif lacking == "application":
        use["application"] = asked.arn("robot-application", "none")
    else:
        use["applicationVersion"] = "9"
    with pytest.raises(ResourceNotFound):
        asked.call("CreateDeploymentJob", **request)
    assert queued_jobs(asked.store) == []


def test_a_fleet_without_robots_takes_no_deployment(asked: Asked):
    with pytest.raises(DocumentError, match="at least one robot"):
        asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet(robots=0)))


@pytest.mark.parametrize("operation", ["DescribeDeploymentJob", "CancelDeploymentJob"])
def test_a_deployment_that_is_not_there_is_not_found(operation: str, asked: Asked):
    with pytest.raises(ResourceNotFound):
        asked.call(operation, job=asked.arn(KIND, "dep-0000000000000000"))


def test_a_failure_code_of_another_kind_is_told_as_an_internal_error(asked: Asked):
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    fail_with_code(asked.store, KIND, path(made), "InvalidInput", "why")
    assert asked.call("DescribeDeploymentJob", job=made["arn"])["failureCode"] == "InternalServerError"
