"""A document's simulation section as a plan."""

from typing import Any

import pytest

from flows.pipeline.references import finder
from specs.errors import DocumentError
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.bundle import ApplicationKind, Version
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import plan_batch
from tasks.storage.base.store import Store

WORLD = "g/w"
BUILDS = {"X86_64": "a", "ARM64": "b"}


def version(kind: ApplicationKind, reference: str, number: str | None) -> Version:
    return Version(kind=kind, name=reference, number=1, digest="a" * 64, size_bytes=1, created_at_s=0.0)


def section(**launch: str) -> SimulationBatch:
    use: dict[str, Any] = {"application": "mine", "launchConfig": {"packageName": "p", **launch}}
    entry = {"maxJobDurationInSeconds": 60, "robotApplications": [use], "simulationApplications": [use]}
    return SimulationBatch.model_validate({"createSimulationJobRequests": [entry]})


@pytest.mark.parametrize("file", ["rotate", "rotate.py", "rotate.launch", "rotate.launch.py"])
def test_a_launch_file_is_a_module_by_whatever_ending_old_documents_name_it(file: str):
    (template,) = plan_batch(section(launchFile=file), [WORLD], {WORLD: ""}, version).templates
    assert template.robot.module == template.scenario.module == "rotate"


@pytest.mark.parametrize("file", ["rotate.launch", "rotate.launch.py"])
def test_a_launch_file_of_ros_keeps_its_ending_and_a_scenario_is_a_module_all_the_same(file: str):
    files = {"p/launch/rotate.launch", "p/launch/rotate.launch.py", "p/rotate.py"}
    asked = section(launchFile=file)
    (template,) = plan_batch(asked, [WORLD], {WORLD: ""}, version, find_files=lambda _: files).templates
    assert (template.robot.launch_file, template.scenario.launch_file) == (file, "rotate")


@pytest.mark.parametrize(("files", "name"), [({"p/rotate.py"}, "rotate"), (set[str](), "rotate.launch")])
def test_a_module_loses_the_ending_of_a_launch_file_and_what_is_missing_keeps_it(files: set[str], name: str):
    asked = section(launchFile="rotate.launch")
    (template,) = plan_batch(asked, [WORLD], {WORLD: ""}, version, find_files=lambda _: files).templates
    assert template.robot.launch_file == name


def test_a_malformed_arn_is_a_fault_of_the_document(file_store: Store):
    batch = section(launchFile="rotate").model_dump(mode="json", exclude_none=True)
    arn = "arn:aws:robomaker:us-east-1:1:robot-applicationMine"
    batch["createSimulationJobRequests"][0]["robotApplications"][0]["application"] = arn
    with pytest.raises(DocumentError, match="robot-applicationMine"):
        plan_batch(SimulationBatch.model_validate(batch), [WORLD], {WORLD: ""}, finder(file_store, {}))


def builds(kind: ApplicationKind, reference: str, number: str | None) -> Version:
    made = [{"architecture": name, "digest": digit * 64, "size_bytes": 1} for name, digit in BUILDS.items()]
    whole = version(kind, reference, number)
    return Version.model_validate({**whole.model_dump(), "builds": made if kind == "robot-application" else []})


@pytest.mark.parametrize(("asked", "simulated"), [(None, "X86_64"), ("X86_64", "X86_64"), ("ARM64", "ARM64")])
def test_of_several_builds_the_one_that_is_asked_for_is_simulated(asked: str | None, simulated: str):
    batch = section(launchFile="rotate").model_dump(mode="json", exclude_none=True)
    batch["createSimulationJobRequests"][0]["robotApplications"][0]["architecture"] = asked
    (template,) = plan_batch(SimulationBatch.model_validate(batch), [WORLD], {WORLD: ""}, builds).templates
    assert (template.robot.architecture, template.robot.digest) == (simulated, BUILDS[simulated] * 64)
    assert (template.scenario.architecture, template.scenario.digest) == (None, "a" * 64)


def judged(launch_file: str, robot: str | None = None) -> SimulationBatch:
    uses = {"simulationApplications": launch_file, **({"robotApplications": robot} if robot else {})}
    entry: dict[str, Any] = {"maxJobDurationInSeconds": 60}
    for kind, file in uses.items():
        entry[kind] = [{"application": kind, "launchConfig": {"packageName": "p", "launchFile": file}}]
    return SimulationBatch.model_validate({"createSimulationJobRequests": [entry]})


ROS_FILES = {"p/launch/judge.launch", "p/launch/drive.launch", "p/launch/two.launch.py", "p/module.py"}


@pytest.mark.parametrize("launch_file", ["judge.launch", "two.launch.py"])
def test_a_simulation_application_of_ros_may_be_alone_and_drives_then(launch_file: str):
    plan = plan_batch(judged(launch_file), [WORLD], {WORLD: ""}, version, find_files=lambda _: ROS_FILES)
    (template,) = plan.templates
    assert template.alone
    assert template.robot == template.scenario
    assert [kind for kind, _ in plan.launches()] == ["simulation-application"]


@pytest.mark.parametrize(
    ("judge", "robot", "why"),
    [
        ("module.launch", None, "a launch file of ROS may be alone"),
        ("module", None, "a simulation application alone must be a launch file of ROS"),
        ("two.launch.py", "drive.launch", "is no launch file of ROS 2 as this one is"),
        ("judge.launch", "module", "is no launch file of ROS 1 as this one is"),
        ("judge.launch", "two.launch.py", "is no launch file of ROS 1 as this one is"),
    ],
)
def test_applications_that_cannot_run_together_are_refused(judge: str, robot: str | None, why: str):
    with pytest.raises(DocumentError, match=why):
        plan_batch(judged(judge, robot), [WORLD], {WORLD: ""}, version, find_files=lambda _: ROS_FILES)


def test_a_robot_of_ros_and_a_judge_of_ros_keep_their_launch_files():
    asked = judged("judge.launch", "drive.launch")
    (template,) = plan_batch(asked, [WORLD], {WORLD: ""}, version, find_files=lambda _: ROS_FILES).templates
    assert (template.robot.launch_file, template.scenario.launch_file) == ("drive.launch", "judge.launch")
    assert not template.alone
    assert template.judge_environment is None


def test_a_module_that_is_named_as_a_launch_file_sees_the_robots_variables():
    document = judged("module.launch", "drive.launch").model_dump(mode="json", exclude_none=True)
    for kind, value in (("robot", "1"), ("simulation", "2")):
        use = document["createSimulationJobRequests"][0][f"{kind}Applications"][0]
        use["launchConfig"]["environmentVariables"] = {"SPEED": value}
    asked = SimulationBatch.model_validate(document)
    with pytest.raises(DocumentError, match="a module sees the same variables"):
        plan_batch(asked, [WORLD], {WORLD: ""}, version, find_files=lambda _: ROS_FILES)


def test_variables_that_both_applications_set_are_each_ones_own():
    document = judged("judge.launch", "drive.launch").model_dump(mode="json", exclude_none=True)
    (entry,) = document["createSimulationJobRequests"]
    for kind, values in (
        ("robot", {"SPEED": "1", "SAME": "x"}),
        ("simulation", {"SPEED": "2", "SAME": "x", "FAR": "3"}),
    ):
        entry[f"{kind}Applications"][0]["launchConfig"]["environmentVariables"] = values
    document["matrix"] = {"environmentVariables": {"FAR": ["4", "5"]}}
    asked = SimulationBatch.model_validate(document)
    plan = plan_batch(asked, [WORLD], {WORLD: ""}, version, find_files=lambda _: ROS_FILES)
    assert plan.templates[0].judge_environment == {"SPEED": "2"}
    request = Layout(plan).request(1)
    assert request.environment == {"SPEED": "1", "SAME": "x", "FAR": "5"}
    assert request.judge_variables == {"SPEED": "2", "SAME": "x", "FAR": "5"}
