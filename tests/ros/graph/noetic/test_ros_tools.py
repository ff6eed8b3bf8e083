"""ROS's own command line tools get on with a graph."""

import subprocess
from pathlib import Path

import pytest

from tests.ros.graph.noetic.ros_episode import PYTHON, RosEpisode
from tests.ros.graph.noetic.ros_sources import ADD_TAGS, CANCEL, TAG

pytestmark = [pytest.mark.long, pytest.mark.integration]


def test_tools_that_ask_get_their_answers(noetic: RosEpisode):
    expected = {
        "rostopic list -v": ["* /scan [sensor_msgs/LaserScan] 1 publisher", "* /cmd_vel [geometry_msgs/Twist] 1 sub"],
        "rostopic type /map": ["nav_msgs/OccupancyGrid"],
        "rosnode list": ["/simyard"],
        "rosnode info /simyard": ["* /clock [rosgraph_msgs/Clock]", "* /robomaker/job/cancel", "Pid:"],
        "rosnode ping -c 1 /simyard": ["xmlrpc reply from http://127.0.0.1"],
        "rosparam list": ["/use_sim_time"],
        "rosservice list": ["/robomaker/job/add_tags"],
        "rosservice type /robomaker/job/cancel": ["robomaker_simulation_msgs/Cancel"],
    }
    for (command, texts), ended in zip(
        expected.items(), noetic.run_all([each.split() for each in expected]), strict=True
    ):
        assert ended.status == 0, (command, ended.output)
        assert all(text in ended.output for text in texts), (command, ended.output)


def test_tools_that_listen_hear_the_robot(noetic: RosEpisode, tmp_path: Path):
    noetic.graph.publish("/map", b"")
    echo, record = noetic.run_all(
        [
            ["rostopic", "echo", "-n", "1", "/scan"],
            ["rosbag", "record", "-l", "5", "-O", str(tmp_path / "some.bag"), "/scan", "/clock"],
        ]
    )
    assert (echo.status, record.status) == (0, 0), (echo, record)
    assert "ranges: [1.0, 1.0, 1.0]" in echo.output
    info = subprocess.run(
        ["rosbag", "info", "some.bag"], env=noetic.environment, cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "sensor_msgs/LaserScan [90c7ef2dc6895d81024acba2ac42f369]" in info.stdout
    assert info.stdout.count("5 msgs") == 2


def test_a_rate_is_measured_in_simulated_time(noetic: RosEpisode):
    ended = noetic.run("timeout", "-s", "INT", "3", "rostopic", "hz", "/scan")
    assert "average rate: " in ended.output


def test_a_command_that_is_published_once_arrives(noetic: RosEpisode):
    ended = noetic.run("rostopic", "pub", "-1", "/cmd_vel", "geometry_msgs/Twist", "[0.5, 0, 0]", "[0, 0, -0.25]")
    assert ended.status == 0, ended.output
    assert noetic.commands == [(0.5, 0.0, -0.25)]


def test_parameters_are_set_read_dumped_and_deleted(noetic: RosEpisode, tmp_path: Path):
    (tmp_path / "some.yaml").write_text("arm: {gain: 0.5, names: [a, b]}\n")
    for command in ("load some.yaml /left", "set /left/speed 3", "delete /left/arm/gain", "dump all.yaml /left"):
        ended = noetic.run("rosparam", *command.split())
        assert ended.status == 0, (command, ended.output)
    assert (tmp_path / "all.yaml").read_text().split() == ["arm:", "names:", "-", "a", "-", "b", "speed:", "3"]


def test_robomakers_services_are_called(noetic: RosEpisode, tmp_path: Path):
    package = tmp_path / "python" / "robomaker_simulation_msgs"
    for folder, files in (("msg", {"Tag": TAG}), ("srv", {"AddTags": ADD_TAGS, "Cancel": CANCEL})):
        (package / folder).mkdir(parents=True)
        for name, text in files.items():
            (tmp_path / f"{name}.{folder}").write_text(text)
            _generate(folder, package / folder, str(tmp_path / f"{name}.{folder}"), tmp_path)
        _generate(folder, package / folder, "--initpy", tmp_path)
    (package / "__init__.py").touch()
    add = noetic.run("rosservice", "call", "/robomaker/job/add_tags", "tags: [{key: site, value: north}]")
    assert "success: True" in add.output
    assert noetic.graph.tags == {"site": "north"}
    assert "success: True" in noetic.run("rosservice", "call", "/robomaker/job/cancel").output
    assert noetic.graph.cancelled


def test_roswtf_finds_no_error_in_the_graph(noetic: RosEpisode):
    output = noetic.run("roswtf").output
    assert "Beginning tests of your ROS graph" in output
    _, _, online = output.partition("Beginning tests of your ROS graph")
    assert "error" not in online.lower().replace("no errors or warnings", ""), online


def _generate(kind: str, out: Path, source: str, folder: Path) -> None:
    """Makes Python of a message's or service's definition, as ROS's packages are built."""
    command = [PYTHON, f"/usr/lib/genpy/gen{kind}_py.py", "-p", "robomaker_simulation_msgs", "-o", str(out)]
    subprocess.run([*command, "-I", f"robomaker_simulation_msgs:{folder}", source], check=True, capture_output=True)
