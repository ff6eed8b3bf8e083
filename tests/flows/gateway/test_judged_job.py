"""A simulation application of ROS by RoboMaker's calls alone: no robot application, no world, no robot.xml."""

from pathlib import Path
from typing import Any

import pytest
from botocore.exceptions import ClientError

from flows.pipeline.world_imports import import_world, keep_world
from specs.arn import arn
from specs.data.outcomes import OUTCOME
from specs.pipeline.world_sections import WorldImport
from tasks.applications.registry import pack, publish_bundle
from tasks.ros.launch.packages import RosInstallation
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import store_id
from tests.factories.gateway.robomaker_client import client_of, running_application
from tests.factories.ros_maps import write_map
from tests.flows.gateway.asked import ROLE, with_applications
from tests.flows.gateway.test_worked_off import client, ended
from tests.flows.pipeline.test_robot_drafts import judged_bundle
from tests.ros.conftest import ros

__all__ = ["client", "ros"]
pytestmark = [pytest.mark.integration, pytest.mark.long]


def test_a_simulation_application_alone_judges_its_job_in_its_own_world(
    client: Any,  # noqa: ANN401 - as above
    file_store: Store,
    tmp_path: Path,
    ros: RosInstallation,
):
    """Made by RoboMaker's calls, of a tar in a bucket that has no robot.xml: its launch file spawns the robot."""
    open_bucket(file_store, "builds").put("judge.tar", pack(judged_bundle(tmp_path / "judge")))
    application = client.create_simulation_application(
        name="judge",
        robotSoftwareSuite={"name": "ROS", "version": "Noetic"},
        simulationSoftwareSuite={"name": "Gazebo", "version": "11"},
        sources=[{"s3Bucket": "builds", "s3Key": "judge.tar", "architecture": "X86_64"}],
    )["arn"]
    launch = {"packageName": "rover_sim", "launchFile": "judged.launch", "environmentVariables": {"SPEED": "0.4"}}
    uses = [{"application": application, "launchConfig": launch}]
    made = client.create_simulation_job(maxJobDurationInSeconds=10, iamRole=ROLE, simulationApplications=uses)
    job = ended(client, "describe_simulation_job", job=made["arn"])
    assert (job["status"], job["tags"][OUTCOME], "robotApplications" in job) == ("Completed", "Passed", False), job
    assert float(job["tags"]["Distance"]) > 0.3
    assert client.list_tags_for_resource(resourceArn=made["arn"])["tags"] == job["tags"]


def test_worlds_of_ones_own_come_by_import_and_by_bundle_and_a_hostile_one_by_none(
    file_store: Store, tmp_path: Path, ros: RosInstallation
):
    """What `simyard world import` put into the store is a job's world; a bundle's is read where it can harm nothing."""
    write_map(tmp_path, ("#" * 80, *("#" + "." * 78 + "#",) * 78, "#" * 80))
    hall = import_world(WorldImport.model_validate({"name": "hall", "source": "map.yaml"}), tmp_path)
    keep_world(file_store, hall)
    bundle = judged_bundle(tmp_path / "judge")
    for world in bundle.rglob("*.world"):
        world.write_text(f'<!DOCTYPE sdf [<!ENTITY a SYSTEM "file:///etc/passwd">]>{world.read_text()}')
    publish_bundle(file_store, "simulation-application", "hostile", bundle)
    asked = with_applications(file_store)
    with running_application(file_store) as send:
        client = client_of(send, tmp_path / "models")
        place = arn("world", store_id(file_store), hall.reference)
        assert [each["arn"].rpartition("/")[2] for each in client.list_worlds()["worldSummaries"]] == ["hall"]
        launch = {"packageName": "rover_sim", "launchFile": "judged.launch"}
        application = asked.arn("simulation-application", "hostile")
        uses = [{"application": application, "launchConfig": launch}]
        with pytest.raises(ClientError, match="a document type: XML without one") as refused:
            client.create_simulation_job(maxJobDurationInSeconds=10, iamRole=ROLE, simulationApplications=uses)
        assert refused.value.response["Error"]["Code"] == "InvalidParameterException"
        assert client.list_simulation_jobs()["simulationJobSummaries"] == []
        made = client.create_simulation_job(**asked.job_request(place))
        assert client.describe_simulation_job(job=made["arn"])["status"] == "Pending"
