"""Calls about fleets, robots and deployment jobs."""

from pathlib import Path
from typing import Any

import pytest

from specs.errors import (
    ConcurrentDeployment,
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceNotFound,
)
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.applications.registry import resolve
from tasks.deploy.fleet.fleet_registry import (
    create_fleet,
    create_robot,
    members,
    read_fleet,
    read_robot,
    register_robot,
)
from tasks.deploy.fleet.reservation import delete_fleet
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.deploy.rollout.operator_commands import command_of
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signer import open_signer
from tasks.deploy.trust.trust_record import require_vouched
from tasks.storage.base.keys import fleet_key, job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import is_queued, leave_queue, queued_jobs
from tasks.storage.jobs.records import advance, read
from tests.factories.gateway.old_records import fail_with_code
from tests.flows.gateway.asked import Asked, path

GROUP = "12345678-1234-1234-1234-123456789012"
KIND = "deployment-job"


def robot(gateway: Asked, name: str = "r", **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateRobot", name=name, architecture="ARM64", greengrassGroupId=GROUP, **more)


def fleet(gateway: Asked, name: str = "f", **more: Any) -> str:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateFleet", name=name, **more)["arn"]


def test_a_fleet_is_described_with_its_robots(gateway: Asked) -> None:
    made = gateway.call("CreateFleet", name="f", tags={"site": "north"})
    member = robot(gateway)["arn"]
    answer = gateway.call("RegisterRobot", fleet=made["arn"], robot=member)
    assert answer == {"fleet": made["arn"], "robot": member}
    described = gateway.call("DescribeFleet", fleet=made["arn"])
    assert {name: described[name] for name in made} == made
    (listed,) = described["robots"]
    assert (listed["arn"], listed["status"], listed["greenGrassGroupId"]) == (member, "Registered", GROUP)


def test_a_robot_is_answered_as_it_was_asked_for(gateway: Asked) -> None:
    made = robot(gateway, tags={"site": "north"})
    assert (made["architecture"], made["greengrassGroupId"], made["tags"]) == ("ARM64", GROUP, {"site": "north"})
    described = gateway.call("DescribeRobot", robot=made["arn"])
    assert {name: described[name] for name in made} == made
    assert described["status"] == "Available"


def test_the_same_fleet_is_made_once(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEETS", "1")
    made = gateway.call("CreateFleet", name="f", tags={"site": "north"})
    assert gateway.call("CreateFleet", name="f") == made
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_FLEETS"):
        fleet(gateway, "g")


def test_a_fleet_takes_no_robot_too_many(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEET_ROBOTS", "1")
    full, empty = fleet(gateway), fleet(gateway, "g")
    first, second = robot(gateway)["arn"], robot(gateway, "s")["arn"]
    for _ in range(2):
        gateway.call("RegisterRobot", fleet=full, robot=first)
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_FLEET_ROBOTS"):
        gateway.call("RegisterRobot", fleet=full, robot=second)
    assert gateway.call("RegisterRobot", fleet=empty, robot=second)


def test_a_robot_belongs_to_one_fleet(gateway: Asked) -> None:
    first, second, member = fleet(gateway), fleet(gateway, "g"), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=first, robot=member)
    with pytest.raises(DocumentError, match="it is in f"):
        gateway.call("RegisterRobot", fleet=second, robot=member)
    with pytest.raises(ResourceNotFound, match="the fleet g"):
        gateway.call("DeregisterRobot", fleet=second, robot=member)
    assert gateway.call("DeregisterRobot", fleet=first, robot=member) == {"fleet": first, "robot": member}
    assert gateway.call("DescribeRobot", robot=member)["status"] == "Available"


def test_the_robots_of_a_deleted_fleet_are_in_none(gateway: Asked) -> None:
    made, member = fleet(gateway), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=member)
    assert gateway.call("DeleteFleet", fleet=made) == {}
    assert "fleetArn" not in gateway.call("DescribeRobot", robot=member)
    assert gateway.call("DeleteRobot", robot=member) == {}
    for call, members_ in [
        ("DescribeFleet", {"fleet": made}),
        ("DescribeRobot", {"robot": member}),
        ("DeleteFleet", {"fleet": made}),
        ("DeleteRobot", {"robot": member}),
        ("RegisterRobot", {"fleet": made, "robot": member}),
        ("DeregisterRobot", {"fleet": made, "robot": member}),
    ]:
        with pytest.raises(ResourceNotFound):
            gateway.call(call, **members_)


def test_a_robot_never_stays_in_a_fleet_that_goes_meanwhile(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    create_fleet(file_store, "f")
    create_robot(file_store, "r")
    replace = file_store.replace

    def after_the_deletion(key: str, body: bytes, etag: str) -> str:
        monkeypatch.undo()
        file_store.delete(fleet_key("f"))
        return replace(key, body, etag)

    monkeypatch.setattr(file_store, "replace", after_the_deletion)
    with pytest.raises(ResourceNotFound):
        register_robot(file_store, "f", "r")
    assert read_robot(file_store, "r").fleet == ""


def test_a_fleet_with_a_deployment_under_way_stays(gateway: Asked) -> None:
    gateway.publish()
    made = gateway.fleet()
    deployment = gateway.call("CreateDeploymentJob", **gateway.deployment_request(made))["arn"]
    described = gateway.call("DescribeFleet", fleet=made)
    assert (described["lastDeploymentJob"], described["lastDeploymentStatus"]) == (deployment, "Pending")
    with pytest.raises(ConcurrentDeployment):
        gateway.call("DeleteFleet", fleet=made)


def test_a_robot_that_is_registered_without_keys_is_in_no_signed_fleet(gateway: Asked, tmp_path: Path) -> None:
    store, keys = gateway.store, tmp_path / "keys"
    init_keys(store, keys)
    made, own, foreign = fleet(gateway), robot(gateway, "own")["arn"], robot(gateway, "foreign")["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=own)
    signer = open_signer(store, keys)
    signer.sign_fleets(lambda fleets: fleets.enlisted("f", ["own"]))
    before = {key: store.get(key).body for key in store.keys("trust")}
    gateway.call("RegisterRobot", fleet=made, robot=foreign)
    gateway.call("DeregisterRobot", fleet=made, robot=own)
    gateway.call("DeleteRobot", robot=own)
    assert [each.name for each in members(store, "f")] == ["foreign"]
    assert signer.fleets().unsigned_members("f", ["foreign"]) == ["foreign"]
    assert {key: store.get(key).body for key in store.keys("trust")} == before
    assert signer.fleets().robots == {"own": "f"}


def test_what_is_left_to_who_has_the_keys_is_logged(
    gateway: Asked, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made, member = fleet(gateway), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=member)
    assert not caplog.messages
    init_keys(gateway.store, tmp_path / "keys")
    gateway.call("DeregisterRobot", fleet=made, robot=member)
    assert "simyard fleet deregister r" in caplog.text


def test_a_deployment_is_recorded_and_queued_and_has_its_fleet(asked: Asked):
    request = asked.deployment_request(asked.fleet(), tags={"team": "blue"})
    made = asked.call("CreateDeploymentJob", **request)
    assert {name: made[name] for name in request if name != "clientRequestToken"} == {
        name: value for name, value in request.items() if name != "clientRequestToken"
    }
    assert made["status"] == "Pending"
    assert is_queued(asked.store, KIND, path(made))
    assert (
        require_vouched(read(asked.store, KIND, path(made)), sync=False).digest
        == resolve(asked.store, "robot-application", "courier").digest
    )
    assert read_fleet(asked.store, "team").deployment == path(made)
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
    assert require_vouched(read(asked.store, KIND, path(made)), sync=True)
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
    assert command_of(asked.store, path(made)) == "cancel"
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
    assert read_fleet(asked.store, "others").deployment == ""


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


def test_a_failure_code_of_another_kind_is_told_as_an_internal_error(asked: Asked):
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    fail_with_code(asked.store, KIND, path(made), "InvalidInput", "why")
    assert asked.call("DescribeDeploymentJob", job=made["arn"])["failureCode"] == "InternalServerError"
