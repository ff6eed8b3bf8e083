"""Calls about jobs, answered from a store that has applications, a world, a template and a fleet."""

from pathlib import Path
from typing import Any

from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from specs.arn import ResourceKind, arn, parse_reference
from specs.base import canonical_document, canonical_json
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.operations import OPERATIONS, document_shapes
from specs.template.body import TemplateBody
from tasks.applications.registry import publish_bundle, resolve
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.rollout.resolved_request import plan_deployment
from tasks.documents.parse import parse
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import leave_queue
from tasks.storage.jobs.records import advance, read
from tasks.storage.store_url import store_id
from tasks.storage.templates import create_template
from tests.factories.worlds import apartment
from tests.repository import ROOT

ROLE = "arn:aws:iam::123456789012:role/simulations"
TEMPLATE = ROOT / "examples/templates/two-rooms.json"


class Asked:
    """A gateway's calls about jobs, without HTTP.

    Args:
        store: What it answers from.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.woken = 0
        self._gateway = Gateway(store, self._wake)

    def call(self, operation: str, **members: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's requests
        """Returns an operation's answer, as it would be sent."""
        request = parse(document_shapes()[OPERATIONS[operation].request], members, operation)
        answer = HANDLERS[operation](self._gateway, request)
        assert type(answer) is document_shapes()[OPERATIONS[operation].answer]
        return answer.model_dump(mode="json", exclude_none=True)

    def arn(self, kind: ResourceKind, path: str) -> str:
        """Returns the ARN of a resource of the store."""
        return arn(kind, store_id(self.store), path)

    def publish(self, folder: Path = ROOT / "applications/courier", name: str = "courier") -> None:
        """Publishes a version of a robot application."""
        publish_bundle(self.store, "robot-application", name, folder)

    def digest(self) -> str:
        """Returns the digest of version 1 of the robot application."""
        return resolve(self.store, "robot-application", "courier", "1").digest

    def world(self, name: str = "w") -> str:
        """Returns the ARN of a world that is in the store now."""
        made = apartment(generation="hand", name=name)
        self.store.put(world_key("hand", name), canonical_json(canonical_document(made)))
        return self.arn("world", f"hand/{name}")

    def template(self) -> str:
        """Returns the ARN of a template that somebody named."""
        body = TemplateBody.model_validate_json(TEMPLATE.read_text())
        return self.arn("world-template", create_template(self.store, body, name="two rooms").id)

    def fleet(self, name: str = "team", robots: int = 1) -> str:
        """Returns the ARN of a fleet with some robots."""
        create_fleet(self.store, name)
        for number in range(robots):
            create_robot(self.store, f"{name}-{number}", "X86_64", {})
            register_robot(self.store, name, f"{name}-{number}")
        return self.arn("deployment-fleet", name)

    def job_request(self, world: str, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's requests
        """Returns what CreateSimulationJob is asked, or an entry of a batch."""
        scenario = _use(self.arn("simulation-application", "delivery"), "delivery", "rooms")
        return {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "robotApplications": [_use(self.arn("robot-application", "courier"), "courier", "go_to_goal")],
            "simulationApplications": [{**scenario, "worldConfigs": [{"world": world}]}],
            **more,
        }

    def deployment_request(self, fleet: str, name: str = "d1", **more: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
        """Returns what CreateDeploymentJob is asked, under a token of that name."""
        use = _use(self.arn("robot-application", "courier"), "courier", "run.sh")
        configs = [{**use, "applicationVersion": "1"}]
        return {"clientRequestToken": name, "fleet": fleet, "deploymentApplicationConfigs": configs, **more}

    def deployed(self, fleet: str, name: str) -> str:
        """Returns the ARN of a deployment to a fleet that has ended."""
        made = self.call("CreateDeploymentJob", **self.deployment_request(self.arn("deployment-fleet", fleet), name))
        request = CreateDeploymentJobRequest.model_validate(read(self.store, "deployment-job", path(made)).request)
        plan = plan_deployment(self.store, request, self.digest()).model_dump(mode="json")
        advance(self.store, "deployment-job", path(made), "Succeeded", detail={"plan": plan})
        leave_queue(self.store, "deployment-job", path(made))
        return made["arn"]

    def _wake(self) -> None:
        self.woken += 1


def with_applications(store: Store) -> Asked:
    """Returns a gateway over a store that gets the two applications that Simyard brings along."""
    made = Asked(store)
    made.publish()
    publish_bundle(store, "simulation-application", "delivery", ROOT / "applications/delivery")
    return made


def path(answer: dict[str, Any]) -> str:
    """Returns what the ARN of an answer ends in."""
    return parse_reference(answer["arn"]).path


def _use(application: str, package: str, launch_file: str) -> dict[str, Any]:
    return {"application": application, "launchConfig": {"packageName": package, "launchFile": launch_file}}


def asked_for_everything(asked: Asked) -> None:
    """Makes each call about jobs once; the store has the applications."""
    world = asked.world()
    worlds = {"template": asked.template(), "worldCount": {"floorplanCount": 1}}
    export = {"worlds": [world], "outputLocation": {"s3Bucket": "exports"}, "iamRole": ROLE}
    for name, request in (("WorldGenerationJob", worlds), ("WorldExportJob", export)):
        job = asked.call(f"Create{name}", **request)["arn"]
        asked.call(f"Describe{name}", job=job)
        asked.call(f"Cancel{name}", job=job)
    entry = asked.job_request(world)
    job = asked.call("CreateSimulationJob", **entry)["arn"]
    asked.call("DescribeSimulationJob", job=job)
    asked.call("BatchDescribeSimulationJob", jobs=[job])
    asked.call("CancelSimulationJob", job=job)
    batch = asked.call("StartSimulationJobBatch", createSimulationJobRequests=[entry])["arn"]
    asked.call("DescribeSimulationJobBatch", batch=batch)
    asked.call("CancelSimulationJobBatch", batch=batch)
    made = asked.call("CreateDeploymentJob", **asked.deployment_request(asked.fleet()))
    asked.call("DescribeDeploymentJob", job=made["arn"])
    asked.call("CancelDeploymentJob", job=made["arn"])
