"""ROS 2 as it is found: folders that stand for what Debian's packages, colcon and the wheels make."""

from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.ros2 import ros2_installation as found_here
from tasks.ros.ros2.ros2_installation import Ros2Installation, ros2_installation


class Prefix:
    """A folder that ROS 2 is installed in."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "share/ament_index").mkdir(parents=True)

    def has(self, *files: str) -> "Prefix":
        """Puts empty files there."""
        for each in files:
            path = self.folder / each
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(0o755)
        return self

    def found(self, **variables: str) -> Ros2Installation:
        """Returns what is found if it is named."""
        return ros2_installation({"AMENT_PREFIX_PATH": str(self.folder), **variables})


CYCLONE, FAST = "lib/librmw_cyclonedds_cpp.so", "lib/librmw_fastrtps_cpp.so"
WHEELS = "lib/python3.11/site-packages"


@pytest.fixture
def prefix(tmp_path: Path) -> Prefix:
    return Prefix(tmp_path / "ros")


@pytest.fixture
def wheels(prefix: Prefix) -> Prefix:
    modules = (f"{WHEELS}/rclpy/__init__.py", f"{WHEELS}/ros_kilted_rclpy-9.1.0.dist-info/METADATA")
    return prefix.has("pyvenv.cfg", "bin/python3", FAST, *modules, f"{WHEELS}/ros_rcl.libs/libyaml.so")


@pytest.mark.parametrize(
    ("libraries", "asked", "middleware"),
    [
        ([CYCLONE, FAST], "", "rmw_cyclonedds_cpp"),
        ([CYCLONE, FAST], "rmw_fastrtps_cpp", "rmw_fastrtps_cpp"),
        ([FAST], "", "rmw_fastrtps_cpp"),
        ([FAST], "rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"),
        (["lib/librmw_zenoh_cpp.so", FAST], "rmw_zenoh_cpp", "rmw_fastrtps_cpp"),
        ([], "", ""),
    ],
)
def test_the_middleware_is_the_one_that_is_asked_for_if_it_is_here(
    prefix: Prefix, libraries: list[str], asked: str, middleware: str
) -> None:
    found = prefix.has(*libraries).found(RMW_IMPLEMENTATION=asked)
    assert found.middleware == middleware
    assert (f"not {asked}" in found.sentence) == bool(asked and asked != middleware)


def test_without_a_middleware_it_says_what_to_install(prefix: Prefix) -> None:
    assert prefix.found(ROS_DISTRO="jazzy").fault == (
        f"ROS 2 jazzy below {prefix.folder} has no middleware that the robot understands: "
        "install ros-jazzy-rmw-cyclonedds-cpp or ros-jazzy-rmw-fastrtps-cpp"
    )


def test_a_prefix_without_ros_2_and_a_python_that_is_not_here_are_faults(prefix: Prefix, tmp_path: Path) -> None:
    nowhere = ros2_installation({"AMENT_PREFIX_PATH": f"{tmp_path}/nowhere"})
    assert nowhere.fault.startswith(f"AMENT_PREFIX_PATH names {tmp_path}/nowhere, where no ROS 2 is")
    found = prefix.has(CYCLONE, "lib/python3.99/site-packages/rclpy/__init__.py").found()
    assert found.fault == f"rclpy below {prefix.folder} is for python3.99, which is not here: install python3.99"


def test_services_that_the_robot_does_not_offer_are_told(prefix: Prefix) -> None:
    told = "so the robot offers no /robomaker/job/add_tags and no /robomaker/job/cancel"
    assert told in prefix.has(FAST).found().sentence
    assert told not in prefix.has(CYCLONE).found().sentence


def test_what_wall_timers_of_cpp_nodes_need_is_told(prefix: Prefix, monkeypatch: pytest.MonkeyPatch) -> None:
    told = "wall timers of rclcpp go by the machine's clock, for there is no C compiler: install gcc and libc6-dev"
    monkeypatch.setattr(found_here, "c_compiler", str)
    assert told not in prefix.has(FAST).found().sentence
    assert told in prefix.has("lib/librclcpp.so").found().sentence
    monkeypatch.setattr(found_here, "c_compiler", lambda: "/usr/bin/cc")
    assert told not in prefix.found().sentence


def test_the_release_is_what_the_installation_says_and_another_name_is_a_fault(prefix: Prefix, wheels: Prefix) -> None:
    assert (wheels.found().distribution, wheels.found().fault) == ("kilted", "")
    assert "ROS_DISTRO is 'jazzy', and ROS 2 kilted is below" in wheels.found(ROS_DISTRO="jazzy").fault
    told = prefix.folder / "share/ros_environment/environment/1.ros_distro.sh"
    told.parent.mkdir(parents=True)
    told.write_text("# generated\nexport ROS_DISTRO=humble\n")
    assert prefix.found().distribution == "humble"


def test_a_virtual_environment_has_a_python_and_libraries_of_its_own(wheels: Prefix) -> None:
    found = wheels.found()
    assert found.python == str(wheels.folder / "bin/python3")
    environment = found.environment()
    libraries = [str(wheels.folder / "lib"), str(wheels.folder / WHEELS / "ros_rcl.libs")]
    assert environment["LD_LIBRARY_PATH"].split(":") == libraries
    assert environment["PYTHONPATH"] == str(wheels.folder / WHEELS)
    # Else each Python of the wheels starts itself once more, to set what is set already.
    assert environment["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] == "1"


def test_a_set_up_file_says_what_programs_see_and_a_bundle_comes_before_it(prefix: Prefix, tmp_path: Path) -> None:
    own = 'AMENT_PREFIX_PATH=/from/setup PYTHONPATH=/py LD_LIBRARY_PATH=/a:/b/x86_64 GAUGE="two words"'
    (prefix.folder / "local_setup.sh").write_text(f"echo sourced\nexport {own}\n")
    environment = prefix.found().environment([tmp_path / "space"])
    assert environment["AMENT_PREFIX_PATH"] == f"{tmp_path}/space:/from/setup"
    assert environment["LD_LIBRARY_PATH"] == f"{tmp_path}/space/lib:/a:/b/x86_64"
    assert (environment["PYTHONPATH"], environment["GAUGE"]) == ("/py", "two words")
    assert "SHLVL" not in environment


def test_a_set_up_file_that_fails_is_said_with_its_last_words(prefix: Prefix) -> None:
    (prefix.folder / "local_setup.sh").write_text("echo no such chain >&2; exit 3\n")
    with pytest.raises(LaunchRefused, match=r"the local_setup\.sh of .* fails: no such chain"):
        prefix.found().environment()


def test_below_opt_the_newest_is_taken_or_the_one_that_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(found_here, "_OPT", tmp_path)
    assert not ros2_installation({}).prefixes
    for name in ("humble", "jazzy"):
        Prefix(tmp_path / name).has(CYCLONE)
    assert ros2_installation({}).prefixes == (tmp_path / "jazzy",)
    assert ros2_installation({"ROS_DISTRO": "humble"}).prefixes == (tmp_path / "humble",)
    assert ros2_installation({"ROS_DISTRO": "humble"}).fault == ""
