"""A simulation application of ROS by RoboMaker's calls alone: no robot application, no world, no robot.xml."""

from pathlib import Path
from typing import Any

import pytest

from specs.data.outcomes import OUTCOME
from tasks.applications.registry import pack
from tasks.ros.launch.packages import RosInstallation
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.flows.gateway.asked import ROLE
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
