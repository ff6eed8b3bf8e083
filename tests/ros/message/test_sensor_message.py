"""Laser scan, inertia, joints and bumper as ROS 1 has them: rosbags reads what we write."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tasks.ros.message import ros_messages
from tasks.ros.message.ros_messages import stamp
from tests.ros.message.message_store import round_trip

RANGES = arrays(np.float64, st.integers(0, 30), elements=st.floats(0.0, 20.0, width=32))


def _scan(ranges_m: np.ndarray, range_max: float = 8.0) -> bytes:
    return ros_messages.laser_scan(
        3,
        stamp(2_500_000_000),
        "laser",
        ranges_m,
        angle_min=-1.5,
        angle_increment=0.1,
        range_max=range_max,
        scan_s=0.05,
    )


@given(ranges_m=RANGES)
def test_a_scan_has_the_ranges_below_its_limit_and_inf_beyond(ranges_m: np.ndarray):
    read = round_trip("sensor_msgs/LaserScan", _scan(ranges_m))
    expected = np.where(ranges_m >= 8.0, np.inf, ranges_m).astype(np.float32)
    np.testing.assert_array_equal(read.ranges, expected)
    assert read.angle_max == pytest.approx(-1.5 + 0.1 * max(len(ranges_m) - 1, 0), abs=1e-6)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (2, 500_000_000)


def test_no_finite_range_equals_the_limit_when_both_are_rounded():
    read = round_trip("sensor_msgs/LaserScan", _scan(np.array([np.nextafter(3.5, 0.0), 3.49]), range_max=3.5))
    assert np.isinf(read.ranges).tolist() == [True, False]


def test_a_ray_that_failed_stays_nan():
    read = round_trip("sensor_msgs/LaserScan", _scan(np.array([np.nan, np.inf, 1.0])))
    assert np.isnan(read.ranges).tolist() == [True, False, False]
    assert np.isinf(read.ranges).tolist() == [False, True, False]


def test_a_scan_leaves_its_ranges_as_they_are():
    ranges_m = np.array([9.0, 1.0], np.float32)
    _scan(ranges_m)
    assert ranges_m.tolist() == [9.0, 1.0]


@given(turn=st.floats(-9, 9), ahead=st.floats(-9, 9), left=st.floats(-9, 9))
def test_an_imu_at_rest_feels_gravity_upward(turn: float, ahead: float, left: float):
    data = ros_messages.imu(1, stamp(0), "imu_link", yaw_rad=0.5, turn_rad_s=turn, acceleration=(ahead, left))
    read = round_trip("sensor_msgs/Imu", data)
    pushed = read.linear_acceleration
    assert (read.angular_velocity.z, pushed.x, pushed.y, pushed.z) == (turn, ahead, left, 9.81)


@given(names=st.lists(st.text(min_size=1, max_size=10), max_size=5))
def test_joints_have_a_position_and_a_speed_each(names: list[str]):
    position = np.arange(len(names), dtype=float)
    read = round_trip("sensor_msgs/JointState", ros_messages.joint_state(1, stamp(0), names, position, -position))
    assert (read.name, read.position.tolist(), read.velocity.tolist()) == (
        names,
        position.tolist(),
        (-position).tolist(),
    )
    assert read.effort.size == 0


@given(sectors=arrays(np.bool_, st.integers(0, 12)))
def test_a_bumper_says_1_for_each_sector_that_touches(sectors: np.ndarray):
    read = round_trip("std_msgs/UInt8MultiArray", ros_messages.bumper(sectors))
    assert read.data.tolist() == sectors.astype(int).tolist()
    assert (read.layout.dim[0].label, read.layout.dim[0].size) == ("sectors", len(sectors))
