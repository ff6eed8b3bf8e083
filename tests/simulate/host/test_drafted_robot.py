"""A robot that was drafted of its description, driven by a node of ROS 1 in an episode, on two engines."""

import math
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.data.world import World
from specs.ros_robot import DraftRequest
from tasks.applications.robot_draft import draft_robot
from tasks.ros.launch.packages import RosInstallation
from tasks.simulate.plan.chunks import Chunk
from tests.factories.simulations import DRIFT, FOLDERS, pushing, simulate_lanes
from tests.repository import ROOT
from tests.ros.conftest import ros

pytestmark = pytest.mark.long
__all__ = ["ros"]

DRAFTED = "8" * 64
ROBOT = ApplicationLaunch(name="rover", version="1", digest=DRAFTED, package="arc", launch_file="arc.launch")
AHEAD_M_S, TURN_RAD_S = 0.2, 0.6
_NODE = f"""#!/usr/bin/env python3
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

rospy.init_node("arc")
speeds = Twist()
speeds.linear.x, speeds.angular.z = {AHEAD_M_S}, {TURN_RAD_S}
commands = rospy.Publisher("cmd_vel", Twist, queue_size=1)
rospy.Subscriber("odom", Odometry, lambda _: commands.publish(speeds))
rospy.spin()
"""


def _bundle(folder: Path) -> Path:
    """Returns a bundle whose robot is a draft, with a node that drives an arc."""
    (folder / "arc/launch").mkdir(parents=True)
    depends = "".join(f"<exec_depend>{name}</exec_depend>" for name in ("rospy", "geometry_msgs", "nav_msgs"))
    (folder / "arc/package.xml").write_text(f"<package format='2'><name>arc</name>{depends}</package>")
    (folder / "arc/launch/arc.launch").write_text('<launch><node pkg="arc" type="drive" name="drive"/></launch>')
    (folder / "arc/drive").write_text(_NODE)
    (folder / "arc/drive").chmod(0o755)
    description = (ROOT / "examples/ros/gazebo/rover_sim/urdf/rover.urdf").read_text()
    draft = draft_robot(DraftRequest(bundle=folder, description=description))
    (folder / "robot.xml").write_text(draft.robot_xml)
    (folder / "ros.yaml").write_text(draft.ros_yaml)
    return folder


def _driven(folder: Path, pens: dict[str, World], engine: str) -> EpisodeResult:
    asked = pushing(0, world="hand/pen-0", seed=1, duration_s=3.0).model_copy(
        update={"robot": ROBOT, "environment": {}}
    )
    folders = {DRAFTED: _bundle(folder), DRIFT: FOLDERS[DRIFT]}
    chunk = Chunk(number=0, requests=(asked,))
    (row,) = simulate_lanes(chunk, pens, folders, lanes=1, engine=engine, should_stop=lambda: False)
    return row


@pytest.mark.parametrize("engine", ["planar", "mujoco"])
def test_a_drafted_robot_drives_an_arc_as_its_plugin_would(
    ros: RosInstallation, pens: dict[str, World], tmp_path: Path, engine: str
):
    row = _driven(tmp_path, pens, engine)
    assert (row.failure_reason, row.engine, row.late, row.stray, row.collisions) == ("", engine, 0, 0, 0)
    course = [each for each in row.trajectory if each[0] >= 1.0]
    (begun_s, *begun), (ended_s, *ended) = course[0], course[-1]
    turned_rad = TURN_RAD_S * (ended_s - begun_s)
    chord_m = 2 * AHEAD_M_S / TURN_RAD_S * math.sin(turned_rad / 2)
    assert (ended[2] - begun[2]) % (2 * math.pi) == pytest.approx(turned_rad, rel=0.02)
    assert math.dist(begun[:2], ended[:2]) == pytest.approx(chord_m, rel=0.02)
