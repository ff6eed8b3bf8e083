"""Messages as ROS 1 has them: rosbags reads what we write, and whatever a service is sent is read or refused."""

import contextlib
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tasks.ros.message import ros_messages
from tasks.ros.message.ros_messages import (
    EarthPlace,
    FrameTransform,
    Inertia,
    PlanarTwist,
    place_beside,
    read_tag_keys,
    read_tags,
    stamp,
    text_bytes,
    write_outcome,
    write_tags,
)
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
    # rosbags reads the seconds with a sign, which ROS 1 does not give them.
    assert read.sec % 2**32 * 1_000_000_000 + read.nanosec == time_ns


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


def test_a_frame_may_have_a_height_or_a_place_and_a_turn_of_any_kind():
    each = [("a", "b", (1.0, 2.0, 0.0, 0.5)), ("a", "c", (1.0, 2.0, 3.0, 0.5, -0.5, 0.5, -0.5))]
    flat, turned = round_trip("tf2_msgs/TFMessage", ros_messages.transforms(0, stamp(0), each)).transforms
    assert (flat.transform.translation.z, flat.transform.rotation.w) == (0.5, 1.0)
    rotation = turned.transform.rotation
    assert (turned.transform.translation.z, rotation.x, rotation.y, rotation.w) == (3.0, 0.5, -0.5, -0.5)


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
def test_an_imu_says_how_it_turns_and_is_pushed(turn: float, ahead: float, left: float):
    data = ros_messages.imu(1, stamp(0), "imu_link", Inertia((0.0, 0.0, turn), (ahead, left, 9.81), yaw_rad=0.5))
    read = round_trip("sensor_msgs/Imu", data)
    pushed = read.linear_acceleration
    assert (read.angular_velocity.z, pushed.x, pushed.y, pushed.z) == (turn, ahead, left, 9.81)
    assert _yaw(read.orientation) == pytest.approx(0.5)
    assert not any((read.orientation_covariance.any(), read.angular_velocity_covariance.any()))


def test_an_imu_without_a_compass_says_that_it_knows_no_orientation():
    data = ros_messages.imu(
        1, stamp(0), "imu_link", Inertia((0.1, 0.2, 0.3), (0.0, 0.0, 9.8), turn_sigma_rad_s=0.01, force_sigma_m_s2=0.2)
    )
    read = round_trip("sensor_msgs/Imu", data)
    assert (read.orientation_covariance[0], read.orientation.w) == (-1.0, 1.0)
    np.testing.assert_allclose(read.angular_velocity_covariance.reshape(3, 3), 1e-4 * np.eye(3))
    np.testing.assert_allclose(read.linear_acceleration_covariance.reshape(3, 3), 0.04 * np.eye(3))


@pytest.mark.parametrize(("range_m", "told"), [(1.25, 1.25), (4.0, math.inf), (np.nextafter(4.0, 0.0), math.inf)])
def test_a_range_finder_that_hears_nothing_says_inf(range_m: float, told: float):
    data = ros_messages.range_reading(
        4, stamp(0), "range", range_m, radiation=ros_messages.INFRARED, cone_rad=0.5, range_max=4.0
    )
    read = round_trip("sensor_msgs/Range", data)
    assert (read.radiation_type, read.field_of_view, read.max_range, read.range) == (1, 0.5, 4.0, told)


def _from_earth_middle(place: EarthPlace) -> np.ndarray:
    """Returns a place of WGS 84 in metres from the earth's middle: to 0 N 0 E, to 0 N 90 E, to the north pole."""
    latitude, longitude = np.radians([place.latitude_deg, place.longitude_deg])
    squared = (2 - 1 / 298.257223563) / 298.257223563
    level_m = 6_378_137.0 / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    out_m = (level_m + place.altitude_m) * np.cos(latitude)
    axis_m = (level_m * (1 - squared) + place.altitude_m) * np.sin(latitude)
    return np.array([out_m * np.cos(longitude), out_m * np.sin(longitude), axis_m])


@given(
    latitude=st.floats(-90, 90),
    longitude=st.floats(-180, 180),
    altitude_m=st.floats(-400, 9000),
    way_m=st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-50, 50)),
)
def test_a_place_some_metres_beside_another_is_so_far_from_it(
    latitude: float, longitude: float, altitude_m: float, way_m: tuple[float, float, float]
):
    origin = EarthPlace(latitude, longitude, altitude_m)
    found = place_beside(origin, way_m)
    sin, cos, east_sin, east_cos = (f(np.radians(x)) for x in (latitude, longitude) for f in (np.sin, np.cos))
    axes = [[-east_sin, east_cos, 0.0], [-sin * east_cos, -sin * east_sin, cos], [cos * east_cos, cos * east_sin, sin]]
    moved_m = np.array(axes) @ (_from_earth_middle(found) - _from_earth_middle(origin))
    np.testing.assert_allclose(moved_m, way_m, atol=1e-6)
    assert -180.0 <= found.longitude_deg <= 180.0


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


TAGS = st.dictionaries(st.text(max_size=20), st.text(max_size=20), max_size=8)


@given(tags=TAGS)
def test_tags_read_as_they_were_written(tags: dict[str, str]):
    assert read_tags(write_tags(tags)) == tags


@given(keys=st.lists(st.text(max_size=20), max_size=8))
def test_keys_read_as_they_were_written(keys: list[str]):
    assert read_tag_keys(struct.pack("<I", len(keys)) + b"".join(map(text_bytes, keys))) == keys


@given(tags=TAGS, cut=st.integers(1, 400))
def test_a_list_that_ends_early_is_refused(tags: dict[str, str], cut: int):
    data = write_tags(tags)
    with pytest.raises(ValueError, match=r"list|text"):
        read_tags(data[: max(len(data) - cut, 0)] if cut <= len(data) else b"")


@given(data=st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(data: bytes):
    with contextlib.suppress(ValueError):
        read_tags(data)


def test_a_list_that_claims_billions_of_tags_is_refused_at_once():
    with pytest.raises(ValueError, match="that ends after 0"):
        read_tags(struct.pack("<I", 2**32 - 1))


def test_an_outcome_is_a_byte_and_a_text():
    assert write_outcome(success=False, message="no") == b"\0\2\0\0\0no"
