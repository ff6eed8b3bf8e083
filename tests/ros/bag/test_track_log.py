"""What a robot did becomes the messages that a ROS robot sends: their frames, their times, their numbers."""

import math
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from specs.ros_robot import RosFrames, RosTopics
from tasks.ros.bag.message_log import LogEntry, MessageLog
from tests.ros.bag.tracks import FLOOR, RAYS, SAMPLES, log, of_topic, track, with_twist

# A second reader of these bytes: rosbags' own.
STORE = get_typestore(Stores.ROS1_NOETIC)
STORE.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))


def read(logged: MessageLog, entry: LogEntry) -> Any:  # noqa: ANN401 - a class that rosbags makes
    kinds = {channel.topic: channel.kind for channel in logged.channels}
    package, _, name = kinds[entry.topic].partition("/")
    return STORE.deserialize_ros1(entry.body, f"{package}/msg/{name}")


def seconds(stamp: Any) -> float:  # noqa: ANN401
    return stamp.sec + stamp.nanosec / 1e9


def yaw(quaternion: Any) -> float:  # noqa: ANN401
    return 2 * math.atan2(quaternion.z, quaternion.w)


@pytest.fixture(scope="module")
def logged() -> MessageLog:
    return log()


def test_each_topic_has_a_message_a_sample_or_a_step_or_a_change(logged: MessageLog):
    counts = {channel.topic: len(of_topic(logged, channel.topic)) for channel in logged.channels}
    assert counts == {
        "/clock": SAMPLES,
        "/tf_static": 1,
        "/tf": SAMPLES,
        "/map": 1,
        "/move_base_simple/goal": 2,
        "/odom": SAMPLES,
        "/ground_truth/odom": SAMPLES,
        "/scan": SAMPLES - 1,
        "/simyard/control": SAMPLES - 1,
        "/simyard/contact_impulse": SAMPLES,
    }


def test_time_begins_at_a_second_and_never_goes_back(logged: MessageLog):
    times = [entry.time_ns for entry in logged.entries]
    assert times[0] == 1_000_000_000
    assert times[-1] == 3_000_000_000
    assert times == sorted(times)


def test_clock_and_headers_say_when_a_message_was_sent(logged: MessageLog):
    for topic in ("/odom", "/scan", "/move_base_simple/goal"):
        for number, entry in enumerate(of_topic(logged, topic)):
            header = read(logged, entry).header
            assert header.stamp.sec * 1_000_000_000 + header.stamp.nanosec == entry.time_ns
            assert header.seq == number
    assert [seconds(read(logged, entry).clock) for entry in of_topic(logged, "/clock")][:2] == [1.0, 1.05]


def test_frames_make_one_tree(logged: MessageLog):
    entries = [*of_topic(logged, "/tf_static"), *of_topic(logged, "/tf")]
    edges = {
        (each.header.frame_id, each.child_frame_id) for entry in entries for each in read(logged, entry).transforms
    }
    assert edges == {("map", "odom"), ("odom", "base_link"), ("base_link", "laser")}
    children = [child for _, child in edges]
    assert len(children) == len(set(children))


def test_every_header_names_a_frame_of_the_tree(logged: MessageLog):
    named = {
        read(logged, each).header.frame_id for topic in ("/odom", "/scan", "/map") for each in of_topic(logged, topic)
    }
    assert named == {"odom", "laser", "map"}


def test_poses_are_those_of_the_track_to_the_last_bit(logged: MessageLog):
    made = track()
    for number, entry in enumerate(of_topic(logged, "/ground_truth/odom")):
        pose = read(logged, entry).pose.pose
        assert (pose.position.x, pose.position.y) == tuple(made.pose[number, :2].tolist())
        assert math.remainder(yaw(pose.orientation) - made.pose[number, 2], 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_odometry_moves_along_the_robots_own_axes(logged: MessageLog):
    made = track()
    entry = of_topic(logged, "/odom")[20]
    linear, angular = read(logged, entry).twist.twist.linear, read(logged, entry).twist.twist.angular
    cos, sin = np.cos(float(made.pose[20, 2])), np.sin(float(made.pose[20, 2]))
    world = (cos * linear.x - sin * linear.y, sin * linear.x + cos * linear.y)
    assert world == pytest.approx(made.velocity[20, :2].tolist())
    assert angular.z == made.velocity[20, 2]


def test_scans_are_those_of_the_track_and_their_rays_as_the_lidar_has_them(logged: MessageLog):
    made = track()
    for number, entry in enumerate(of_topic(logged, "/scan")):
        assert read(logged, entry).ranges.tolist() == made.ranges_m[number].tolist()
    scan = read(logged, of_topic(logged, "/scan")[0])
    assert (scan.angle_min, scan.angle_increment, scan.angle_max) == (-0.5, 0.25, 0.5)
    assert (scan.range_max, scan.scan_time) == (6.0, pytest.approx(0.05))


def test_a_ray_that_sees_nothing_is_infinite():
    made = track()
    made.ranges_m[0] = 6.0
    assert np.isinf(read(log(made), of_topic(log(made), "/scan")[0]).ranges).all()


def test_the_lidar_stands_where_it_is_mounted(logged: MessageLog):
    _, lidar = read(logged, of_topic(logged, "/tf_static")[0]).transforms
    place = lidar.transform.translation
    assert (place.x, place.y, place.z, yaw(lidar.transform.rotation)) == pytest.approx((0.1, 0.0, 0.2, 0.5))


def test_the_map_is_the_worlds(logged: MessageLog):
    grid = read(logged, of_topic(logged, "/map")[0])
    assert grid.data.tolist() == [0, 100, 100, 0, 0, 0]
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (FLOOR.columns, FLOOR.rows, 0.5)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == FLOOR.origin_m


def test_controls_and_impulses_are_those_of_the_track(logged: MessageLog):
    made = track()
    controls = [read(logged, entry).data.tolist() for entry in of_topic(logged, "/simyard/control")]
    assert controls == made.control[:-1].tolist()
    impulses = [read(logged, entry).data for entry in of_topic(logged, "/simyard/contact_impulse")]
    assert impulses == made.impulse_ns.tolist()


def test_commands_are_there_where_the_drive_is_known():
    logged = log(with_twist())
    commands = [read(logged, entry) for entry in of_topic(logged, "/cmd_vel")]
    assert len(commands) == SAMPLES - 1
    assert (commands[0].linear.x, commands[0].linear.y, commands[0].angular.z) == (0.5, 0.25, -1.0)


def test_a_blind_robot_has_neither_scans_nor_a_lidars_frame():
    logged = log(track(rays=0))
    assert "/scan" not in {channel.topic for channel in logged.channels}
    assert len(read(logged, of_topic(logged, "/tf_static")[0]).transforms) == 1


def test_topics_and_frames_are_called_as_the_robot_declares():
    topics = RosTopics(scan="/front/scan", odometry=None, goal=None, floor_map="/floor")
    made = track()._replace(topics=topics, frames=RosFrames(base="chassis", laser="front_laser"))
    logged = log(made)
    names = {channel.topic for channel in logged.channels}
    assert {"/front/scan", "/floor"} <= names
    assert not {"/scan", "/odom", "/map", "/move_base_simple/goal"} & names
    assert read(logged, of_topic(logged, "/front/scan")[0]).header.frame_id == "front_laser"
    assert read(logged, of_topic(logged, "/tf")[0]).transforms[0].child_frame_id == "chassis"


def test_scans_have_as_many_rays_as_the_lidar(logged: MessageLog):
    assert len(read(logged, of_topic(logged, "/scan")[3]).ranges) == RAYS
