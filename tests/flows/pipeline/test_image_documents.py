"""Documents whose robot application is a container image: checked before anything runs, planned with its command."""

import shutil
from pathlib import Path

import pytest

from flows.pipeline.bundle_checks import check_own_bundles
from flows.pipeline.launch_notes import ros_launch_faults
from flows.pipeline.references import resolve_references
from flows.pipeline.robot_drafts import with_images
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec, inert_fields
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.sandbox.launch_check import check_launch_file
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.store import Store
from tasks.storage.container_image import image_bundle
from tests.repository import ROOT
from tests.storage.made_images import docker_archive, file, layer

_ROBOT = (ROOT / "examples/ros/turtlebot3/robot.xml").read_bytes()
_PROGRAM = file("usr/bin/roslaunch")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def _document(launch: object, **application: object) -> PipelineSpec:
    own = {"name": "roamer", "source": "app.tar", **application}
    scenario = {"application": "delivery", "launchConfig": {"packageName": "delivery", "launchFile": "rooms"}}
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "roamer", "launchConfig": launch}],
        "simulationApplications": [scenario],
    }
    return PipelineSpec.model_validate(
        {
            "name": "image",
            "applications": [own],
            "worldGeneration": {"template": "x", "worldCount": {"floorplanCount": 1}},
            "simulationBatch": {
                "outputLocation": {"s3Bucket": "results"},
                "matrix": {"worlds": "all", "seeds": 1},
                "createSimulationJobRequests": [request],
            },
        }
    )


_COMMAND = {"command": ["roslaunch", "roamer", "roam.launch"]}


def _faults(spec: PipelineSpec, base: Path) -> list[str]:
    try:
        check_own_bundles(with_images(spec, base), base)
    except DocumentError as exc:
        return [f"{fault.path}: {fault.value}: {fault.allowed}" for fault in exc.faults]
    return []


def test_an_image_with_a_robot_and_the_program_that_is_named_is_right(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    assert _faults(_document(_COMMAND), tmp_path) == []
    assert _faults(_document({"packageName": "roamer", "launchFile": "roam.launch"}), tmp_path) == []
    assert inert_fields(_document(_COMMAND)) == []


@pytest.mark.parametrize(
    ("launch", "why"),
    [
        ({"command": ["python3", "/app/node.py"]}, "the image has no program 'python3'"),
        ({"command": ["/app/run"]}, "the image has no program '/app/run'"),
        ({"packageName": "roamer", "launchFile": "roam.launch.py"}, "the image has no program 'ros2'"),
    ],
)
def test_an_image_without_the_program_is_refused(launch: object, why: str, tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    (fault,) = _faults(_document(launch), tmp_path)
    assert why in fault


@pytest.mark.parametrize(
    ("command", "launch_file", "field"),
    [(("python3", "x"), "", ".command: 'python3 x'"), (None, "run", ".launchFile: 'run'")],
)
def test_what_a_stored_image_lacks_is_named_as_of_one_of_the_document(
    command: tuple[str, ...] | None, launch_file: str, field: str, tmp_path: Path
) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    source = LaunchSource(image_bundle("app.tar", tmp_path), "app", launch_file, command)
    report = check_launch_file(source, [{}], own=False)
    (fault,) = ros_launch_faults("launchConfig", source, report)
    assert f"{fault.path}: {fault.value}: {fault.allowed}".startswith(f"launchConfig{field}: the image has no program")
    assert report.unknown == report.nodes  # no topic is told to have no publisher beside it


def test_an_image_without_ros_is_refused_before_anything_runs(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), file("app/run"))])
    (fault,) = _faults(_document({"command": ["/app/run"]}), tmp_path)
    assert "no ROS: neither /opt/ros, nor roslaunch, nor rclpy: install it there, as ros:noetic has it" in fault


def test_an_image_without_a_robot_is_refused_unless_it_lies_beside(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(_PROGRAM)])
    (fault,) = _faults(_document(_COMMAND), tmp_path)
    assert "a container image with /simyard/robot.xml, or `robot: FOLDER`" in fault
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot/robot.xml").write_bytes(_ROBOT)
    assert _faults(_document(_COMMAND, robot="robot"), tmp_path) == []


def _judged(judge: object, *robots: object) -> PipelineSpec:
    """Returns a document whose simulation application is the image."""
    document = _document(_COMMAND).model_dump(mode="json", exclude_none=True)
    document["applications"][0] |= {"name": "examiner", "kind": "simulation"}
    request = document["simulationBatch"]["createSimulationJobRequests"][0]
    request["simulationApplications"][0] |= {"application": "examiner", "launchConfig": judge}
    request["robotApplications"] = [*robots]
    if not robots:
        del request["robotApplications"]
    return PipelineSpec.model_validate(document)


_COURIER = {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "go_to_goal"}}


def test_an_image_judges_by_its_command_or_a_launch_file_and_alone_only_with_a_robot(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(_PROGRAM)])
    for launch in (_COMMAND, {"packageName": "roamer", "launchFile": "roam.launch"}):
        assert _faults(_judged(launch, _COURIER), tmp_path) == []
    assert inert_fields(_judged(_COMMAND, _COURIER)) == []
    module, _ = _faults(_judged({"packageName": "roamer", "launchFile": "judge"}, _COURIER), tmp_path)
    assert "what examiner's image runs to judge: a command, or a launch file of ROS" in module
    (alone,) = _faults(_judged(_COMMAND), tmp_path)
    assert "a container image with /simyard/robot.xml" in alone
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    assert _faults(_judged(_COMMAND), tmp_path) == []


def test_an_image_that_judges_is_planned_beside_nodes_alone(tmp_path: Path, file_store: Store) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    plans = OverlayStore(file_store)
    found = resolve_references(_with_template(_judged(_COMMAND)), plans, tmp_path).batch
    assert found is not None
    (template,) = found.templates
    assert (template.scenario.starts_nodes, template.alone) == (True, True)
    assert template.scenario.launched == "roslaunch roamer roam.launch"
    with pytest.raises(DocumentError, match="a module, as the robot application's go_to_goal is no container image"):
        resolve_references(_with_template(_judged(_COMMAND, _COURIER)), plans, tmp_path)


def test_a_bundle_whose_image_is_damaged_is_refused_with_what_else_is_wrong(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    shutil.copytree(image_bundle("app.tar", tmp_path), tmp_path / "app")
    (tmp_path / "app/image.json").write_text("{}")
    (tmp_path / "app/robot.xml").write_text("no robot")
    damaged, robot = _faults(_document(_COMMAND, source="app"), tmp_path)
    assert damaged.startswith(
        "simulationBatch.createSimulationJobRequests[0].robotApplications[0].launchConfig: roamer: "
    )
    assert "a container image that can be run here; image.json: " in damaged
    assert robot.startswith("applications[0].source: app: ")


def test_what_is_no_image_is_refused_where_the_document_names_it(tmp_path: Path) -> None:
    (tmp_path / "app.tar").write_bytes(b"none")
    (fault,) = _faults(_document(_COMMAND), tmp_path)
    assert fault.startswith("applications[0].source: app.tar: a container image that can be run here; ")


def test_a_command_is_for_images_alone(tmp_path: Path) -> None:
    (tmp_path / "folder/roamer").mkdir(parents=True)
    (tmp_path / "folder/roamer/drive.py").write_text("")
    (fault,) = _faults(_document(_COMMAND, source="folder"), tmp_path)
    assert "roamer is no container image, which a command is for" in fault


def test_an_image_of_which_nothing_is_said_needs_a_command(tmp_path: Path) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)], {"Cmd": ["roslaunch"]})
    assert all(fault.endswith("; of a container image a command will do") for fault in _faults(_document({}), tmp_path))


def test_the_command_is_planned_and_the_digest_is_of_all_layers(tmp_path: Path, file_store: Store) -> None:
    docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM)])
    digests = list[str]()
    for more in ((), (layer(file("more")),)):
        docker_archive(tmp_path / "app.tar", [layer(file("simyard/robot.xml", _ROBOT), _PROGRAM), *more])
        spec = _document(_COMMAND).model_copy(update={"worldGeneration": None})
        found = resolve_references(_with_template(spec), OverlayStore(file_store), tmp_path)
        assert found.batch is not None
        robot = found.batch.templates[0].robot
        assert (robot.command, robot.package, robot.launch_file) == (("roslaunch", "roamer", "roam.launch"), "", "")
        digests.append(robot.digest)
    assert digests[0] != digests[1]


def _with_template(spec: PipelineSpec) -> PipelineSpec:
    document = spec.model_dump(mode="json", exclude_none=True)
    template = str(ROOT / "examples/templates/two-rooms.json")
    document["worldGeneration"] = {"template": template, "worldCount": {"floorplanCount": 1}}
    return PipelineSpec.model_validate(document)
