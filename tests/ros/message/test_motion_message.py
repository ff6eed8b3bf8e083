"""Clock, odometry, transforms, goal, map and command as ROS 1 has them: rosbags reads what we write."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tasks.ros.message import ros_messages
from tasks.ros.message.ros_messages import FrameTransform, PlanarTwist, stamp
from tests.ros.message.message_store import round_trip

TIMES = st.integers(0, 2**32 * 1_000_000_000 - 1)
SEQUENCES = st.integers(0, 2**32 - 1)
FRAMES = st.text(max_size=20)
NUMBERS = st.floats(-1e6, 1e6)
POSES = st.tuples(NUMBERS, NUMBERS, st.floats(-math.pi, math.pi))


def _yaw(orientation: object) -> float:
    assert getattr(orientation, "x") == getattr(orientation, "y") == 0.0  # noqa: B009 - rosbags' types are made at run time
    return 2.0 * math.atan2(getattr(orientation, "z"), getattr(orientation, "w"))  # noqa: B009


@given(time_ns=TIMES)
def test_a_clock_says_the_time(time_ns: int):
    read = round_trip("rosgraph_msgs/Clock", ros_messages.clock(stamp(time_ns))).clock
    assert read.sec * 1_000_000_000 + read.nanosec == time_ns


@given(sequence=SEQUENCES, time_ns=TIMES, frames=st.tuples(FRAMES, FRAMES), pose=POSES, velocity=POSES)
def test_odometry_says_pose_and_velocity(
    sequence: int,
    time_ns: int,
    frames: tuple[str, str],
    pose: tuple[float, float, float],
    velocity: tuple[float, float, float],
):
    data = ros_messages.odometry(
        sequence, stamp(time_ns), np.array(pose), np.array(velocity), frame=frames[0], child=frames[1]
    )
    read = round_trip("nav_msgs/Odometry", data)
    assert (read.header.seq, read.header.frame_id, read.child_frame_id) == (sequence, *frames)
    assert (read.pose.pose.position.x, read.pose.pose.position.y) == pose[:2]
    assert _yaw(read.pose.pose.orientation) == pytest.approx(pose[2])
    twist = read.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == velocity


@given(each=st.lists(st.builds(FrameTransform, FRAMES, FRAMES, POSES), max_size=5))
def test_transforms_say_where_each_frame_is(each: list[FrameTransform]):
    read = round_trip("tf2_msgs/TFMessage", ros_messages.transforms(3, stamp(5), each)).transforms
    found = [(one.header.frame_id, one.child_frame_id, one.transform.translation.x) for one in read]
    assert found == [(one.parent, one.child, one.pose[0]) for one in each]


@given(pose=POSES, frame=FRAMES)
def test_a_goal_says_where_to_go(pose: tuple[float, float, float], frame: str):
    read = round_trip("geometry_msgs/PoseStamped", ros_messages.pose_stamped(1, stamp(9), frame, pose))
    assert (read.header.frame_id, read.pose.position.x, read.pose.position.y) == (frame, *pose[:2])


@given(cells=arrays(np.int8, st.tuples(st.integers(0, 8), st.integers(0, 8)), elements=st.integers(-1, 100)))
def test_a_map_has_rows_from_its_origin(cells: np.ndarray):
    data = ros_messages.occupancy_grid(0, stamp(7), "map", cells, origin_m=(-1.0, 2.0), cell_m=0.05)
    read = round_trip("nav_msgs/OccupancyGrid", data)
    assert (read.info.height, read.info.width) == cells.shape
    assert (read.info.origin.position.x, read.info.origin.position.y) == (-1.0, 2.0)
    assert read.data.tolist() == cells.ravel().tolist()


@given(command=st.builds(PlanarTwist, NUMBERS, NUMBERS, NUMBERS))
def test_a_command_reads_as_it_was_written(command: PlanarTwist):
    data = ros_messages.twist(command)
    assert ros_messages.read_twist(data) == command
    assert round_trip("geometry_msgs/Twist", data).angular.z == command.turn_rad_s


@given(data=st.binary(max_size=100).filter(lambda data: len(data) != 48))
def test_bytes_that_are_no_twist_are_refused(data: bytes):
    with pytest.raises(ValueError, match="a geometry_msgs/Twist has 48"):
        ros_messages.read_twist(data)
