"""A container image by RoboMaker's calls alone, from a registry to a job that it drives."""

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from specs.data.outcomes import OUTCOME
from tasks.applications.registry import publish_bundle
from tasks.ros.launch.message_modules import make_message_modules
from tasks.ros.launch.packages import RosInstallation
from tasks.storage.base.store import Store
from tasks.storage.image_files import new_tree
from tests.flows.gateway.asked import ROLE, Asked
from tests.flows.gateway.test_image_calls import pushed, registry
from tests.flows.gateway.test_worked_off import client, ended
from tests.integration.runs import own_cache
from tests.repository import ROOT
from tests.ros.conftest import ros
from tests.storage.made_images import docker_archive, file, layer

__all__ = ["client", "registry", "ros"]
pytestmark = [pytest.mark.integration, pytest.mark.long]
_BUNDLE = ROOT / "examples/ros/turtlebot3"
_MADE_OF = {"name": "General"}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, registry: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The cache of this test and of its worker, which is started after this."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("SIMYARD_CACHE", own_cache(folder))
    monkeypatch.setenv("SIMYARD_REGISTRIES", registry)
    return folder


@pytest.fixture
def packages() -> Iterator[Path]:
    """The packages of a robot and of what judges it outside ``/tmp``, which is another one inside."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        packages = shutil.copytree(_BUNDLE, Path(folder) / "src")
        shutil.copytree(ROOT / "tests/data/ros/examiner", packages / "examiner")
        yield packages


@pytest.fixture
def digest(packages: Path, registry: str, ros: RosInstallation, tmp_path: Path) -> str:
    """The digest of an image with the variables of this machine's ROS, and with RoboMaker's messages."""
    own = ros.environment()
    messages = make_message_modules(packages.parent / "messages", ros, ["robomaker_simulation_msgs"])
    variables = {
        **own,
        "ROS_PACKAGE_PATH": f"{packages}:{own['ROS_PACKAGE_PATH']}",
        "PYTHONPATH": ":".join(filter(None, [str(messages or ""), own.get("PYTHONPATH", "")])),
    }
    robot = [file(f"simyard/{name}", (_BUNDLE / name).read_bytes()) for name in ("robot.xml", "ros.yaml")]
    config = {"Env": [f"{name}={value}" for name, value in variables.items()]}
    archive = docker_archive(tmp_path / "app.tar", [layer(*robot, file("usr/bin/roslaunch"))], config)
    return pushed(archive, registry, tmp_path)


@pytest.fixture
def application(
    client: Any,  # noqa: ANN401 - botocore has no types
    cache: Path,
    digest: str,
    registry: str,
) -> str:
    """The ARN of a robot application with a version of that image."""
    image = {"uri": f"{registry}/robot:1"}
    made = client.create_robot_application(name="roamer", robotSoftwareSuite=_MADE_OF, environment=image)["arn"]
    client.create_robot_application_version(application=made, imageDigest=digest)
    # In place of the image's files are this machine's, with the ROS that the image would have.
    (unpacked,) = [path for path in (cache / "images").iterdir() if len(path.name) == 64]
    shutil.rmtree(unpacked)
    with new_tree(unpacked, ".unpack-") as files:
        files.rmdir()
        files.symlink_to("/")
    return made


def _ended(client: Any, application: str, judge: Mapping[str, object], world: str) -> Any:  # noqa: ANN401 - botocore has no types
    launch = {"command": ["roslaunch", "roamer", "roam.launch"]}
    made = client.create_simulation_job(
        maxJobDurationInSeconds=20,
        iamRole=ROLE,
        robotApplications=[{"application": application, "launchConfig": launch}],
        simulationApplications=[{**judge, "worldConfigs": [{"world": world}]}],
    )
    return ended(client, "describe_simulation_job", job=made["arn"])


def test_a_job_is_driven_by_the_command_of_an_image_of_a_registry(
    client: Any,  # noqa: ANN401 - botocore has no types
    application: str,
    file_store: Store,
):
    asked = Asked(file_store)
    publish_bundle(file_store, "simulation-application", "drills", ROOT / "examples/ros/drills")
    launch = {"packageName": "drills", "launchFile": "roam", "environmentVariables": {"METRES": "0.5"}}
    drill = {"application": asked.arn("simulation-application", "drills"), "launchConfig": launch}
    job = _ended(client, application, drill, asked.world())
    assert (job["status"], job["tags"].get(OUTCOME)) == ("Completed", "Passed"), job


def test_a_job_is_judged_by_the_command_of_an_image_of_a_registry(
    client: Any,  # noqa: ANN401 - botocore has no types
    application: str,
    digest: str,
    file_store: Store,
    registry: str,
):
    image = {"uri": f"{registry}/robot:1"}
    suites = {"robotSoftwareSuite": _MADE_OF, "simulationSoftwareSuite": {"name": "SimulationRuntime"}}
    judge = client.create_simulation_application(name="examiner", environment=image, **suites)["arn"]
    client.create_simulation_application_version(application=judge, imageDigest=digest)
    command = {"command": ["roslaunch", "examiner", "examine.launch"]}
    job = _ended(client, application, {"application": judge, "launchConfig": command}, Asked(file_store).world())
    assert (job["status"], job["tags"].get(OUTCOME), job["tags"].get("drives_Status")) == (
        "Completed",
        "Passed",
        "Passed",
    ), job
