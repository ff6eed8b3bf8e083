"""Records that a stranger changed: lists leave them out, and show what is everybody else's."""

import json
from typing import Any

import pytest

from tasks.applications.registry import publish_bundle
from tasks.storage.base.store import Store
from tests.flows.gateway.jobs.asked import ROLE, Asked, path
from tests.repository import ROOT

STRANGE: dict[str, dict[str, Any]] = {
    "no record": {"kind": None},
    "an ARN that is none": {"arn": "strange"},
    "no request": {"request": {}},
    "a request of texts": {"request": {"request": "x", "plan": "y", "worlds": None}},
}


@pytest.fixture
def asked(file_store: Store) -> Asked:
    made = Asked(file_store)
    made.publish()
    publish_bundle(file_store, "simulation-application", "delivery", ROOT / "applications/delivery")
    return made


def _change(store: Store, key: str, **members: Any) -> None:  # noqa: ANN401 - what a stranger writes
    store.put(key, json.dumps({**json.loads(store.get(key).body), **members}).encode())


@pytest.mark.parametrize("strange", STRANGE.values(), ids=STRANGE)
def test_a_strange_job_is_left_out_of_lists(asked: Asked, strange: dict[str, Any]):
    export = {"worlds": [asked.world()], "outputLocation": {"s3Bucket": "exports"}, "iamRole": ROLE}
    ours, theirs = (asked.call("CreateWorldExportJob", **export) for _ in range(2))
    _change(asked.store, f"jobs/world-export-job/{path(theirs)}.json", **strange)

    listed = asked.call("ListWorldExportJobs")["worldExportJobSummaries"]

    assert [each["arn"] for each in listed] == [ours["arn"]]


@pytest.mark.parametrize("strange", STRANGE.values(), ids=STRANGE)
def test_a_strange_batch_is_left_out_of_the_lists_of_jobs(asked: Asked, strange: dict[str, Any]):
    request = asked.job_request(asked.world())
    ours, theirs = (asked.call("CreateSimulationJob", **request) for _ in range(2))
    _change(asked.store, f"jobs/simulation-job-batch/{path(theirs).split('/')[0]}.json", **strange)

    listed = [each["arn"] for each in asked.call("ListSimulationJobs")["simulationJobSummaries"]]

    assert ours["arn"] in listed
    assert asked.call("ListSimulationJobBatches")["simulationJobBatchSummaries"] == []


@pytest.mark.parametrize("strange", [{"name": None}, {"name": "another"}], ids=["no record", "of another"])
def test_a_strange_application_is_left_out_of_lists(asked: Asked, strange: dict[str, Any]):
    asked.publish(name="strange")
    _change(asked.store, "applications/robot-application/strange.json", **strange)

    listed = asked.call("ListRobotApplications")["robotApplicationSummaries"]

    assert [each["name"] for each in listed] == ["courier"]


@pytest.mark.parametrize("strange", [{"kind": None}, {"arn": "strange"}, {"status": "Strange"}])
def test_a_fleet_with_a_strange_deployment_is_listed_without_it(asked: Asked, strange: dict[str, Any]):
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    _change(asked.store, f"jobs/deployment-job/{path(made)}.json", **strange)

    (listed,) = asked.call("ListFleets")["fleetDetails"]

    assert listed["name"] == "team"
    assert "lastDeploymentStatus" not in listed


def test_a_strange_template_is_left_out_of_lists(asked: Asked):
    strange = asked.template()
    body = (ROOT / "examples/templates/two-rooms.json").read_text()
    ours = asked.call("CreateWorldTemplate", name="ours", templateBody=body)
    asked.store.put(f"world-templates/{path({'arn': strange})}.json", b"{")

    listed = asked.call("ListWorldTemplates")["templateSummaries"]

    assert ours["arn"] in [each["arn"] for each in listed]


def test_a_fleet_that_names_no_deployment_is_listed(asked: Asked):
    asked.fleet()
    _change(asked.store, "fleets/team.json", deployment="../../else")

    assert [each["name"] for each in asked.call("ListFleets")["fleetDetails"]] == ["team"]
