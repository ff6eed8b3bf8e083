"""What a robot publishes, by what it has and how it is declared."""

import math

import numpy as np
import pytest

from specs.bundle_files import BumperDeclaration, LidarDeclaration, RosRobot, RosTopics
from tasks.ros.lockstep.exchange import Base, FloorPlan, Sensed
from tasks.ros.lockstep.robot_topics import Moment, SensorMessages

SENSED = Sensed(
    np.zeros(3), np.zeros(3), np.zeros(2), np.ones(4, np.float32), np.ones(3, np.bool_), np.array([1.0, 2.0])
)
MOMENT = Moment(3, 1_500_000_000, SENSED)


def messages(robot: RosRobot, rays: int = 4) -> SensorMessages:
    return SensorMessages(Base(robot, rays, -math.pi, math.pi / 2, 8.0), 0.05)


def test_the_clock_comes_first_and_the_scan_last() -> None:
    order = messages(RosRobot(bumper=BumperDeclaration())).order
    assert order == ("/clock", "/tf", "/odom", "/joint_states", "/imu", "/bumper", "/scan")


def test_what_a_robot_lacks_is_no_topic() -> None:
    topics = RosTopics(odometry=None, imu=None, joints=None, goal=None)
    found = messages(RosRobot(topics=topics, lidar=None), rays=0)
    assert found.order == ("/clock", "/tf")
    assert {topic.name for topic in found.topics} == {"/clock", "/tf", "/tf_static"}
    assert found.goal(MOMENT) is None


def test_each_topic_has_a_message() -> None:
    found = messages(RosRobot(bumper=BumperDeclaration()))
    assert all(found.write(topic, MOMENT) for topic in found.order)
    goal = found.goal(MOMENT)
    assert goal is not None
    assert goal[0] == "/move_base_simple/goal"


@pytest.mark.parametrize("declared", [None, "/map"])
def test_the_map_is_there_if_it_is_declared(declared: str | None) -> None:
    floor = FloorPlan(np.zeros((2, 3), np.int8), (0.0, 0.0), 0.1)
    found = messages(RosRobot(topics=RosTopics(floor_map=declared))).fixed(MOMENT, floor)
    assert set(found) == {"/tf_static", *([declared] if declared else [])}
    assert (b"map" in found["/tf_static"]) == (declared is not None)


def test_the_lidar_is_where_it_is_mounted() -> None:
    ahead = messages(RosRobot(lidar=LidarDeclaration(x_m=0.25))).fixed(MOMENT, None)["/tf_static"]
    assert np.float64(0.25).tobytes() in ahead
