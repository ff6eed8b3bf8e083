"""From a call to Completed: a botocore client, the gateway, a worker in a process of its own, and a robot's agent."""

import json
import shutil
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from flows.queue.supervisor import QueueWorkers
from specs.arn import parse_reference
from specs.data.outcomes import OUTCOME
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import queued_jobs
from tests.deploy.yard import FLEET, Yard, kill
from tests.factories.gateway.robomaker_client import client_of, running_application
from tests.flows.gateway.asked import ROLE, TEMPLATE, Asked
from tests.repository import ROOT
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.soak]  # two compilations
UNDER_WAY = {"Pending", "Preparing", "Running", "InProgress", "Completing", "Terminating", "Canceling"}
# The scenario of the other tests, in worlds where only a job that knows its own name may begin.
TOLD = """
import re

from .rooms import scenario as rooms


class Told:
    def __init__(self, inner, job):
        self._inner, self._job = inner, job

    def __getattr__(self, name):
        return getattr(self._inner, name)

    def place(self, *given):
        if not re.fullmatch("sim-[0-9a-f]{16}[0-9]+", self._job):
            raise ValueError(f"which job is this: {self._job!r}")
        return self._inner.place(*given)


def scenario(environment):
    return Told(rooms(environment), environment.get("AWS_ROBOMAKER_SIMULATION_JOB_ID", ""))
"""


@pytest.fixture
def client(file_store: Store, tmp_path: Path, prefect_server: str) -> Generator[Any]:
    """A client of a gateway whose worker uses the tests' Prefect server."""
    with QueueWorkers(file_store.url), running_application(file_store) as send:
        yield client_of(send, tmp_path / "models")


@pytest.fixture
def robot(file_store: Store, tmp_path: Path) -> Generator[None]:
    """A fleet of one robot whose agent runs."""
    create_fleet(file_store, FLEET)
    create_robot(file_store, "r1", "X86_64", {})
    register_robot(file_store, FLEET, "r1")
    agent = Yard(file_store, tmp_path).start_agent("r1")
    yield
    kill(agent)


def ended(client: Any, operation: str, **job: str) -> dict[str, Any]:  # noqa: ANN401 - botocore has no types
    """Returns what a Describe call answers once its job has ended."""
    while (found := getattr(client, operation)(**job))["status"] in UNDER_WAY:
        time.sleep(0.1)
    return found


@pytest.mark.usefixtures("robot")
def test_each_kind_of_job_comes_to_its_end(client: Any, file_store: Store, tmp_path: Path):  # noqa: ANN401 - as above
    template = client.create_world_template(name="two rooms", templateBody=TEMPLATE.read_text())["arn"]
    made = client.create_world_generation_job(template=template, worldCount={"floorplanCount": 1})
    worlds = ended(client, "describe_world_generation_job", job=made["arn"])
    assert worlds["status"] == "Completed"
    (world,) = worlds["finishedWorldsSummary"]["succeededWorlds"]
    body = client.get_world_template_body(generationJob=made["arn"])["templateBody"]
    assert json.loads(body) == json.loads(client.get_world_template_body(template=template)["templateBody"])

    place = {"s3Bucket": "exports", "s3Prefix": "home"}
    made = client.create_world_export_job(worlds=[world], outputLocation=place, iamRole=ROLE)
    assert ended(client, "describe_world_export_job", job=made["arn"])["status"] == "Completed"

    request = _applications(file_store, tmp_path, world)
    made = client.create_simulation_job(**request, tags={"team": "blue"})
    job = ended(client, "describe_simulation_job", job=made["arn"])
    assert (job["status"], job["tags"]["team"]) == ("Completed", "blue"), job
    assert job["tags"][OUTCOME] in {"Passed", "Failed"}
    assert client.list_tags_for_resource(resourceArn=made["arn"])["tags"] == job["tags"]
    assert job["simulationTimeMillis"] > 0
    assert job["lastStartedAt"] <= job["lastUpdatedAt"]

    batch = client.start_simulation_job_batch(createSimulationJobRequests=[request, request])
    described = ended(client, "describe_simulation_job_batch", batch=batch["arn"])
    assert described["status"] == "Completed"
    arns = [each["arn"] for each in described["createdRequests"]]
    jobs = client.batch_describe_simulation_job(jobs=arns)["jobs"]
    assert [each["tags"][OUTCOME] for each in jobs] == [job["tags"][OUTCOME]] * 2

    _deploys(client, Asked(file_store))
    eventually(lambda: queued_jobs(file_store) == [])


def _applications(store: Store, tmp_path: Path, world: str) -> dict[str, Any]:
    """Returns a request for a job of the shipped applications, in a scenario that asks which job it is."""
    asked = Asked(store)
    asked.publish()
    folder = shutil.copytree(ROOT / "applications/delivery", tmp_path / "delivery")
    (folder / "delivery/told.py").write_text(TOLD)
    publish_bundle(store, "simulation-application", "delivery", folder)
    request = asked.job_request(world)
    request["simulationApplications"][0]["launchConfig"]["launchFile"] = "told"
    return request


def _deploys(client: Any, asked: Asked) -> None:  # noqa: ANN401 - as above
    fleet = asked.arn("deployment-fleet", FLEET)
    made = client.create_deployment_job(**asked.deployment_request(fleet))
    deployed = ended(client, "describe_deployment_job", job=made["arn"])
    assert deployed["status"] == "Succeeded"
    (shown,) = deployed["robotDeploymentSummary"]
    assert (parse_reference(shown["arn"]).path, shown["status"]) == ("r1", "InSync")
    synced = client.sync_deployment_job(clientRequestToken="s1", fleet=fleet)
    assert synced["deploymentApplicationConfigs"] == deployed["deploymentApplicationConfigs"]
    assert ended(client, "describe_deployment_job", job=synced["arn"])["status"] == "Succeeded"
