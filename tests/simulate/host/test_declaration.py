"""How an application is driven follows from its files, without running any of them."""

import ast
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from specs.ros_robot import RosRobot
from tasks.ros.ros2.dds_domain import DOMAINS
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host import declaration
from tasks.simulate.host.controllers import HostBundle
from tasks.simulate.host.declaration import (
    available_bytes,
    controller_kind,
    launch_path,
    load_controller,
    most_lanes,
    read_ros_robot,
)
from tasks.simulate.host.ros_controllers import ros_application
from tasks.simulate.sensors.lidar import Lidar
from tasks.simulate.sensors.sensor_table import Sensors, read_color_camera, read_sensors
from tests.factories.simulations import FOLDERS, delivery
from tests.simulate.host.fake_lockstep import BUNDLE, ROS_ROBOT, FakeLocksteps, ros_bundle

MAKES_ONE = "def controller(environment):\n    ...\n"
MAKES_ALL = "def controllers(environments):\n    ...\n"


def kind(folder: Path, files: dict[str, str], launch_file: str = "nav") -> str:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    launch = ApplicationLaunch(name="r", version="1", digest="0" * 64, package="nav", launch_file=launch_file)
    return controller_kind(folder, launch)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"jax = False\n{MAKES_ONE}", "plain"),
        (f'"""Text."""\nimport numpy\njax = False\n{MAKES_ONE}', "plain"),
        (f"jax = False\n{MAKES_ALL}", "batched"),
        (f"jax = False\n{MAKES_ONE}{MAKES_ALL}", "batched"),
        (MAKES_ALL, "jax"),
        ("import jax", "jax"),
        ("jax = True", "jax"),
        ("class A:\n    jax = False\n", "jax"),
        ("jax = no python (", "jax"),
        ("jax = False\x00", "jax"),
    ],
)
def test_a_module_is_what_it_says_at_its_top(tmp_path: Path, text: str, expected: str):
    assert kind(tmp_path, {"nav/nav.py": text}) == expected


def test_what_is_not_there_is_told_when_it_is_imported(tmp_path: Path):
    assert kind(tmp_path, {}) == "jax"


@pytest.mark.parametrize("launch_file", ["nav", "nav.onnx"])
def test_a_network_is_launched_in_place_of_a_module(tmp_path: Path, launch_file: str):
    assert kind(tmp_path, {"nav/nav.onnx": ""}, launch_file) == "onnx"


def test_a_module_comes_before_a_network_of_its_name(tmp_path: Path):
    assert kind(tmp_path, {"nav/nav.py": "", "nav/nav.onnx": ""}) == "jax"


@pytest.mark.parametrize(
    ("launch_file", "expected"), [("go.launch", "ros"), ("go.launch.py", "ros2"), ("go.launch.xml", "ros2")]
)
@pytest.mark.parametrize("folder", ["nav/launch", "nav", "src/nav/launch"])
def test_a_launch_file_of_ros_is_found_by_its_name(tmp_path: Path, folder: str, launch_file: str, expected: str):
    files = {f"{folder}/{launch_file}": "", "src/nav/package.xml": "<package/>"}
    assert kind(tmp_path, files, launch_file) == expected


def test_a_module_that_documents_from_before_call_a_launch_file_is_the_module(tmp_path: Path):
    assert kind(tmp_path, {"nav/go.py": ""}, "go.launch") == "jax"


def test_a_launch_file_above_its_bundle_is_none(tmp_path: Path):
    (tmp_path / "go.launch").write_text("")
    (tmp_path / "bundle/nav").mkdir(parents=True)
    launch = ApplicationLaunch(name="r", version="1", digest="0" * 64, package="nav", launch_file="../../go.launch")
    assert launch_path(tmp_path / "bundle", launch) is None


def test_a_module_is_parsed_once_until_it_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    parsed: list[object] = []
    parse = ast.parse
    monkeypatch.setattr(ast, "parse", lambda text: (parsed.append(text), parse(text))[1])
    plain = {"nav/nav.py": f"jax = False\n{MAKES_ONE}"}
    assert [kind(tmp_path, plain), kind(tmp_path, {}), kind(tmp_path, {})] == ["plain"] * 3
    assert len(parsed) == 1
    assert kind(tmp_path, {"nav/nav.py": MAKES_ONE}) == "jax"


def test_a_kind_is_read_without_jax():
    code = "import sys, tasks.simulate.host.declaration; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def told(folder: Path, memory: str, limit: str = "", used: str = "") -> Path:
    (folder / "proc").mkdir()
    (folder / "proc/meminfo").write_text(memory)
    if limit:
        (folder / "sys/fs/cgroup").mkdir(parents=True)
        (folder / "sys/fs/cgroup/memory.max").write_text(limit)
        (folder / "sys/fs/cgroup/memory.current").write_text(used)
    return folder


def test_controllers_without_processes_are_not_bounded():
    assert most_lanes([delivery(0, world="hand/one")], FOLDERS) is None


@pytest.mark.parametrize(("free", "most"), [(1 << 20, 8), (20 * (128 << 20), 12), (1 << 50, 16)])
def test_lanes_of_ros_are_bounded_by_memory_and_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, most: int
):
    monkeypatch.setattr(declaration, "available_bytes", lambda: free)
    monkeypatch.setattr(declaration.os, "sched_getaffinity", lambda _: {0})
    asked = [delivery(0, world="hand/one").model_copy(update={"robot": ROS_ROBOT})]
    assert most_lanes(asked, {BUNDLE: ros_bundle(tmp_path / "bundle")}) == most


@pytest.mark.parametrize(("name", "most"), [("drive.launch", 1024), ("drive.launch.py", 96)])
def test_lanes_of_ros_2_are_never_more_than_there_are_domains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, most: int
):
    monkeypatch.setattr(declaration, "available_bytes", lambda: 1 << 50)
    monkeypatch.setattr(declaration.os, "sched_getaffinity", lambda _: {*range(64)})
    bundle = ros_bundle(tmp_path / "bundle")
    (bundle / "patrol/launch/drive.launch.py").touch()
    robot = ROS_ROBOT.model_copy(update={"launch_file": name})
    asked = [delivery(0, world="hand/one").model_copy(update={"robot": robot})]
    assert most_lanes(asked, {BUNDLE: bundle}) == most
    assert name == "drive.launch" or most <= len(DOMAINS)


def test_memory_is_what_is_free_of_the_machine(tmp_path: Path):
    assert available_bytes(told(tmp_path, "MemTotal: 9 kB\nMemAvailable:   5 kB\n")) == 5 << 10


@pytest.mark.parametrize(("limit", "free"), [("3000", 1000), ("max", 5 << 10), ("1000", 0)])
def test_a_container_may_have_less(tmp_path: Path, limit: str, free: int):
    assert available_bytes(told(tmp_path, "MemAvailable: 5 kB\n", limit, "2000")) == free


def test_a_machine_that_tells_nothing_has_none(tmp_path: Path):
    assert available_bytes(tmp_path) == 0


def sensors_of(folder: Path) -> Sensors:
    application = ros_application(HostBundle(folder, ROS_ROBOT), "ros", FakeLocksteps())
    return read_sensors(application.declare, {"KIND": "none"})


def test_a_bundle_that_declares_nothing_has_the_defaults(tmp_path: Path):
    assert read_ros_robot(tmp_path) == RosRobot()


def test_an_empty_file_declares_nothing(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("# nothing yet\n")
    assert read_ros_robot(tmp_path) == RosRobot()


def test_all_faults_of_a_declaration_are_told_at_once(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {command: cmd_vel}\nlidar: {rays: 0}\ncommand_timeout: 1\n")
    with pytest.raises(RobotRefused) as refused:
        read_ros_robot(tmp_path)
    for part in ("topics.command: 'cmd_vel'", "lidar.rays: 0", "command_timeout: 1"):
        assert f"ros.yaml: {part}" in str(refused.value)


def test_an_unknown_key_is_told_with_those_that_are_known(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {skan: /scan}\nlidr: {}\n")
    with pytest.raises(RobotRefused) as refused:
        read_ros_robot(tmp_path)
    assert "topics.skan: '/scan': an unknown key; known are command, scan, odometry" in str(refused.value)
    assert "lidr: {}: an unknown key; known are topics, frames, lidar" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: [1, 2", "no YAML"),
        ("- lidar", "should be a valid"),
        ("a: &a [x, x]\nb: &b [*a, *a]\n", "an alias"),
        ("[" * 5000, "more than 16 levels"),
        ("x" * 70_000, "more than 65536 bytes"),
        ("ready_s: " + ":".join(["1"] * 300) + ".0", "too large"),
        ("ready_s: !!int ''", "no YAML"),
        ("ready_s: !!timestamp x", "no YAML"),
        ("ready_s: !!bool x", "no YAML"),
    ],
)
def test_what_is_no_declaration_is_refused(tmp_path: Path, text: str, why: str):
    (tmp_path / "ros.yaml").write_text(text)
    with pytest.raises(RobotRefused, match=why):
        read_ros_robot(tmp_path)


def test_sensors_are_those_that_are_declared(tmp_path: Path):
    declaration = "lidar: {rays: 90, range_m: 5, x_m: 0.1}\nodometry: {sigma_m_per_m: 0.02}\nbumper: {sectors: 4}\n"
    found = sensors_of(ros_bundle(tmp_path, declaration))
    assert found.lidar == Lidar(rays=90, range_m=5.0, height_m=0.2, fov_rad=found.lidar.fov_rad, x_m=0.1)
    assert found.odometry is not None
    assert found.odometry.sigma_m_per_m == 0.02
    assert found.bumper.sectors == 4


def test_a_sensor_that_no_topic_tells_of_is_none(tmp_path: Path):
    found = sensors_of(ros_bundle(tmp_path, "topics: {scan: null, bumper: null}\nbumper: {}\n"))
    assert (found.lidar.rays, found.bumper.sectors) == (0, 0)


@pytest.mark.parametrize(
    ("declaration", "why"),
    [
        ("lidar: {rays: none}", "ros.yaml: lidar.rays: 'none'"),
        ("drive: {kind: velocity, forward: go}", "drive.forward: go: no actuator of robot.xml"),
    ],
)
def test_a_refused_declaration_is_the_applications_crash(tmp_path: Path, declaration: str, why: str):
    with pytest.raises(BundleCrash) as crash:
        sensors_of(ros_bundle(tmp_path, declaration))
    assert crash.value.code == "RobotApplicationCrash"
    assert crash.value.reason.startswith("wheels: ")
    assert why in crash.value.reason


SENSING = """<mujoco><worldbody><body name="base" pos="0 0 0.2">
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint name="yaw" type="hinge" axis="0 0 1"/>
<geom size="0.1"/><camera name="eye" resolution="80 60" pos="0.1 0 0.2" xyaxes="0 -1 0 0 0 1"/>
<site name="left" euler="-90 0 0"/><site name="front" euler="0 90 0"/><site name="right" euler="90 0 0"/>
</body></worldbody><actuator><velocity joint="yaw"/></actuator>
<sensor><rangefinder site="left"/><rangefinder site="front"/><rangefinder site="right"/></sensor></mujoco>"""


def test_a_declaration_has_what_it_asks_the_robots_file_for_and_what_it_says_itself(tmp_path: Path):
    (tmp_path / "robot.xml").write_text(SENSING)
    declared = "depth_camera: {mjcf: eye, columns: 40, rate_hz: 10}\nrange_finders: {mjcf: [right, front, left]}\n"
    (tmp_path / "ros.yaml").write_text(declared)
    robot = read_ros_robot(tmp_path)
    camera, finders = robot.depth_camera, robot.range_finders
    assert camera is not None
    assert finders is not None
    assert (camera.columns, camera.rows, camera.x_m, camera.z_m, camera.rate_hz) == (40, 60, 0.1, 0.4, 10.0)
    assert (finders.finders, finders.first_rad, finders.apart_rad) == (3, -1.570796, 1.570796)
    assert robot.color_camera is None, "nobody asks for it"


def test_each_camera_of_a_list_may_ask_for_one_of_the_robots_file(tmp_path: Path):
    (tmp_path / "robot.xml").write_text(SENSING)
    listed = "[{name: front, mjcf: eye}, {name: rear, mjcf: eye, yaw_rad: 3.1}]"
    (tmp_path / "ros.yaml").write_text(f"depth_camera: {listed}")
    camera = read_ros_robot(tmp_path).depth_camera
    assert camera is not None
    assert [(each.name, each.columns, each.x_m) for each in camera.every] == [("front", 80, 0.1), ("rear", 80, 0.1)]
    assert camera.others[0].yaw_rad == 3.1
    make = seer(tmp_path, "c", "eye", "[Eye(), Eye()]\n    depth_camera[0].name, depth_camera[1].name = 'a', 'b'")
    seen = read_sensors(make, {}).depth_camera
    assert seen is not None
    assert [(each.name, each.columns, each.z_m) for each in seen.every] == [("a", 80, 0.4), ("b", 80, 0.4)]


@pytest.mark.parametrize(
    ("declared", "refusal"),
    [
        ("depth_camera: {mjcf: ey}", "'ey': no camera of robot.xml: must be one of eye"),
        ("imu: {mjcf: chip}", "'chip': no imu of robot.xml: it has none that can be taken"),
        ("depth_camera: {mjcf: [eye, eye]}", "eye, eye: must be one name; of range finders several that are alike"),
        ("range_finders: {mjcf: [left, front]}\nlidar: {mjcf: eye}", "lidar.mjcf: 'eye': an unknown key"),
    ],
)
def test_what_the_robots_file_does_not_have_is_refused(tmp_path: Path, declared: str, refusal: str):
    (tmp_path / "robot.xml").write_text(SENSING)
    (tmp_path / "ros.yaml").write_text(declared)
    with pytest.raises(RobotRefused, match=re.escape(refusal)):
        read_ros_robot(tmp_path)


CONTROLLER = """
class Eye:
    mjcf = "{name}"
    range_m = 4.0
    rate_hz = 5.0


class Seer:
    depth_camera = color_camera = {eyes}
    answer = 42


def controller(environment):
    return Seer()
"""


def seer(folder: Path, digest: str, name: str, eyes: str = "Eye()") -> Callable[..., object]:
    (folder / "robot.xml").write_text(SENSING)
    (folder / "seer").mkdir()
    (folder / "seer/seer.py").write_text(CONTROLLER.format(name=name, eyes=eyes))
    launch = ApplicationLaunch(name="r", version="1", digest=digest * 64, package="seer", launch_file="seer")
    return load_controller(folder, launch, "controller")


def test_a_controller_has_the_camera_of_the_robots_file_that_it_asks_for(tmp_path: Path):
    make = seer(tmp_path, "d", "eye")
    camera, color = read_sensors(make, {}).depth_camera, read_color_camera(make, {})
    assert camera is not None
    assert color is not None
    for each in (camera, color):
        assert (each.columns, each.rows, each.x_m, each.z_m) == (80, 60, 0.1, 0.4)
        assert (each.range_m, each.rate_hz) == (4.0, 5.0)
    assert make({}).answer == 42  # type: ignore[attr-defined]


def test_a_controller_that_asks_for_what_is_not_there_has_crashed(tmp_path: Path):
    with pytest.raises(BundleCrash, match=r"depth_camera\.mjcf: 'nose': no camera of robot"):
        read_sensors(seer(tmp_path, "e", "nose"), {})
