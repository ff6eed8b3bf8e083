"""What a robot publishes, by what it has and how it is declared, and what a recorder keeps of it."""

import math
import struct
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from specs.bundle_files import (
    BumperDeclaration,
    ColorCameraDeclaration,
    CompassDeclaration,
    GpsDeclaration,
    LidarDeclaration,
)
from specs.ros_robot import RosDepthCamera, RosImu, RosRangeFinders, RosRobot, RosTopics
from tasks.ros.bag.message_log import LogEntry, MessageLog, with_other_topics
from tasks.ros.lockstep.exchange import ExchangeTotals, FloorMap, GoalEnd, RobotBase, Sensed, TwistCommand
from tasks.ros.lockstep.robot_topics import NAVIGATE, LockstepRecorder, SensorMessages, undeclared
from tasks.ros.lockstep.sensor_topics import LARGE, Moment
from tests.ros.bag.tracks import log, of_topic
from tests.ros.message.message_store import round_trip

SENSED = Sensed(
    np.zeros(3), np.zeros(3), np.zeros(2), np.ones(4, np.float32), np.ones(3, np.bool_), np.array([1.0, 2.0])
)
MOMENT = Moment(3, 1_500_000_000, SENSED)


def messages(robot: RosRobot, rays: int = 4) -> SensorMessages:
    return SensorMessages(RobotBase(robot, rays, -math.pi, math.pi / 2, 8.0), 0.05)


def test_the_clock_comes_first_and_the_scan_last() -> None:
    order = messages(RosRobot(bumper=BumperDeclaration())).order
    assert order == ("/clock", "/tf", "/odom", "/joint_states", "/imu", "/bumper", "/scan")


def test_what_a_robot_lacks_is_no_topic() -> None:
    topics = RosTopics(odometry=None, imu=None, joints=None, goal=None)
    found = messages(RosRobot(topics=topics, lidar=None), rays=0)
    assert found.order == ("/clock", "/tf")
    assert {topic.name for topic in found.topics} == {"/clock", "/tf", "/tf_static"}
    assert found.goal(MOMENT) is None


def test_topics_of_sensors_that_a_robot_may_have_are_known_with_their_declaration() -> None:
    found = undeclared(RosRobot(topics=RosTopics(color_image="/eye", bumper=None), depth_camera=RosDepthCamera()))
    assert found == {
        **dict.fromkeys(["/eye", "/eye/compressed", "/camera/color/camera_info"], "color_camera"),
        "/range": "range_finders",
        "/imu/mag": "compass",
        "/fix": "gps",
    }


def test_each_topic_has_a_message() -> None:
    found = messages(RosRobot(bumper=BumperDeclaration()))
    assert all(found.write(topic, MOMENT) for topic in found.order)
    goal = found.goal(MOMENT)
    assert goal is not None
    assert goal[0] == "/move_base_simple/goal"


@pytest.mark.parametrize("declared", [None, "/map"])
def test_the_map_is_there_if_it_is_declared(declared: str | None) -> None:
    floor = FloorMap(np.zeros((2, 3), np.int8), (0.0, 0.0), 0.1)
    found = messages(RosRobot(topics=RosTopics(floor_map=declared))).fixed(MOMENT, floor)
    assert set(found) == {"/tf_static", *([declared] if declared else [])}
    assert (b"map" in found["/tf_static"]) == (declared is not None)


@pytest.mark.parametrize("given", [True, False])
def test_a_localizer_of_the_application_is_told_the_start_and_nothing_more(*, given: bool) -> None:
    topics = RosTopics(floor_map="/map", localized="/amcl_pose", initial_pose="/initialpose")
    own = messages(RosRobot(topics=topics, localization="given" if given else "application"))
    found, told = own.fixed(MOMENT, None), own.goal(MOMENT)
    assert (b"map" in found["/tf_static"]) == given
    assert found["/initialpose"] == own.write("/amcl_pose", MOMENT)
    assert told is not None
    assert (told[0], b"map" in told[1], b"odom" in told[1]) == ("/move_base_simple/goal", not given, given)


def test_a_goal_for_an_action_is_on_the_map_and_on_no_topic() -> None:
    own = messages(RosRobot(topics=RosTopics(floor_map="/map"), goals="navigate_to_pose"))
    told = own.goal(MOMENT)
    assert told is not None
    assert (told[0], b"map" in told[1]) == (NAVIGATE, True)
    assert not {"/move_base_simple/goal", NAVIGATE} & {each.name for each in own.topics}


def test_the_lidar_is_where_it_is_mounted() -> None:
    ahead = messages(RosRobot(lidar=LidarDeclaration(x_m=0.25))).fixed(MOMENT, None)["/tf_static"]
    assert np.float64(0.25).tobytes() in ahead


SEES = RosRobot(
    lidar=LidarDeclaration(rate_hz=5.0),
    depth_camera=RosDepthCamera(
        columns=4, rows=2, x_m=0.1, z_m=0.4, pitch_rad=0.3, rate_hz=10.0, latency_steps=1, encoding="16UC1"
    ),
    color_camera=ColorCameraDeclaration(columns=3, rows=2, rate_hz=4.0),
    imu=RosImu(z_m=0.05, yaw_rad=0.5, gyro_sigma_rad_s=0.1, rate_hz=10.0),
    range_finders=RosRangeFinders(finders=2, first_rad=0.5, apart_rad=-1.0, out_m=0.2, radiation="infrared"),
    compass=CompassDeclaration(sigma_ut=2.0, rate_hz=10.0),
    gps=GpsDeclaration(latitude_deg=60.0, longitude_deg=10.0, sigma_m=3.0, drift_m=4.0, z_m=0.3, latency_steps=2),
)
READINGS = {
    "depth_m": np.full((2, 4), 1.5, np.float32),
    "color": np.arange(18, dtype=np.uint8).reshape(2, 3, 3),
    "turn_rad_s": np.array([0.1, 0.2, 0.3], np.float32),
    "force_m_s2": np.array([0.0, 0.0, 9.8], np.float32),
    "finder_m": np.array([1.0, 4.0], np.float32),
    "field_ut": np.array([20.0, 0.0, -45.0], np.float32),
    "gps_m": np.array([0.0, 1000.0, 0.3], np.float32),
}


def at(step: int) -> Moment:
    """Returns a moment of the episode; nodes warmed up for ten steps before."""
    return Moment(step + 10, 1_500_000_000 + 50_000_000 * step, SENSED._replace(readings=READINGS), step)


def test_each_sensor_has_its_rate_and_the_steps_between_are_without_it() -> None:
    found = messages(SEES)
    due = {
        topic: [step for step in range(-2, 11) if topic in found.due(at(step))]
        for topic in ("/odom", "/scan", "/imu", "/range_1", "/camera/depth/image_raw", "/camera/color/image_raw")
    }
    assert due["/odom"] == due["/range_1"] == [*range(-2, 11)]
    assert (due["/scan"], due["/imu"]) == ([0, 4, 8], [-2, 0, 2, 4, 6, 8, 10])
    assert due["/camera/color/image_raw"] == [0, 5, 10]
    assert due["/camera/depth/image_raw"] == [1, 3, 5, 7, 9], "none before the first picture has arrived"


def test_a_scan_says_how_long_it_is_until_the_next() -> None:
    assert round_trip("sensor_msgs/LaserScan", messages(SEES).write("/scan", at(4))).scan_time == np.float32(0.2)


def test_a_picture_has_the_time_at_which_it_was_taken_and_its_own_frame() -> None:
    found = messages(SEES)
    kinds = {topic.name: topic.kind for topic in found.topics}
    for name in ("image_raw", "camera_info", "points"):
        read = round_trip(kinds[f"/camera/depth/{name}"], found.write(f"/camera/depth/{name}", at(3)))
        stamped = (read.header.stamp.nanosec, read.header.frame_id)
        assert stamped == (600_000_000, "camera_depth_optical_frame"), "a step before 1.65 s"
    depth = round_trip("sensor_msgs/Image", found.write("/camera/depth/image_raw", at(3)))
    assert (depth.encoding, np.frombuffer(bytes(depth.data), "<u2").tolist()) == ("16UC1", [1500] * 8)
    color = round_trip("sensor_msgs/Image", found.write("/camera/color/image_raw", at(5)))
    assert (color.encoding, color.data.tolist(), color.header.frame_id) == (
        "rgb8",
        list(range(18)),
        "camera_color_optical_frame",
    )


def test_a_compass_tells_the_field_and_a_gps_the_place_on_the_earth() -> None:
    found = messages(SEES)
    field = round_trip("sensor_msgs/MagneticField", found.write("/imu/mag", at(2)))
    assert (field.header.frame_id, field.magnetic_field.x, field.magnetic_field.z) == ("base_link", 20e-6, -45e-6)
    assert field.magnetic_field_covariance[4] == pytest.approx(4e-12)
    fix = round_trip("sensor_msgs/NavSatFix", found.write("/fix", at(2)))
    assert (fix.header.frame_id, fix.header.stamp.nanosec, fix.status.status) == ("gps", 500_000_000, 0)
    # A degree of latitude is 111.4 km long there.
    assert (fix.latitude, fix.longitude) == (pytest.approx(60.0 + 1 / 111.4, abs=1e-5), pytest.approx(10.0))
    assert fix.position_covariance.tolist() == [25.0, 0, 0, 0, 25.0, 0, 0, 0, 100.0]
    assert fix.position_covariance_type == 2


def test_a_declared_imu_says_what_it_measures_and_how_it_errs() -> None:
    read = round_trip("sensor_msgs/Imu", messages(SEES).write("/imu", at(2)))
    turn, force = read.angular_velocity, read.linear_acceleration
    assert (turn.x, turn.z, force.z) == pytest.approx((0.1, 0.3, 9.8))
    assert (read.orientation_covariance[0], read.angular_velocity_covariance[4]) == (-1.0, pytest.approx(0.01))
    knows = SEES.model_copy(update={"imu": RosImu(yaw_rad=0.5, heading=True)})
    read = round_trip("sensor_msgs/Imu", messages(knows).write("/imu", at(2)))
    assert (read.orientation.z, read.orientation_covariance[0]) == (pytest.approx(math.sin(0.25)), 0.0)


def test_each_range_finder_has_a_topic_and_the_only_one_no_number() -> None:
    found = messages(SEES)
    read = [round_trip("sensor_msgs/Range", found.write(topic, at(0))) for topic in ("/range_0", "/range_1")]
    assert [(each.range, each.radiation_type, each.header.frame_id) for each in read] == [
        (1.0, 1, "range_0"),
        (math.inf, 1, "range_1"),
    ]
    alone = messages(RosRobot(range_finders=RosRangeFinders()))
    assert "/range" in alone.order


def test_frames_are_where_sensors_are_mounted() -> None:
    read = round_trip("tf2_msgs/TFMessage", messages(SEES).fixed(at(0), None)["/tf_static"]).transforms
    found = {each.child_frame_id: each.transform for each in read}
    places = {name: (each.translation.x, each.translation.y, each.translation.z) for name, each in found.items()}
    assert places == {
        "imu_link": (0.0, 0.0, 0.05),
        "gps": (0.0, 0.0, 0.3),
        "range_0": pytest.approx((0.2 * math.cos(0.5), 0.2 * math.sin(0.5), 0.2)),
        "range_1": pytest.approx((0.2 * math.cos(0.5), -0.2 * math.sin(0.5), 0.2)),
        "laser": (0.0, 0.0, 0.0),
        "camera_depth_optical_frame": (0.1, 0.0, 0.4),
        "camera_color_optical_frame": (0.0, 0.0, 0.3),
    }
    level = found["camera_color_optical_frame"].rotation
    assert (level.x, level.y, level.z, level.w) == (-0.5, 0.5, -0.5, 0.5)


def test_a_recording_keeps_no_pictures() -> None:
    traffic = LockstepRecorder(Answers(), RobotBase(SEES, 4, -math.pi, math.pi / 2, 8.0), 0.05)
    traffic.begin([at(0).sensed], [None])
    for _ in range(5):
        traffic.exchange([at(0).sensed])
    kept = traffic.log()
    assert {channel.topic for channel in kept.channels} >= {"/camera/depth/camera_info", "/range_0"}
    assert not {channel.kind for channel in kept.channels} & LARGE
    counts = [len(of_topic(kept, topic)) for topic in ("/odom", "/scan", "/camera/depth/camera_info")]
    assert counts == [5, 2, 2]


BASE = RobotBase(RosRobot(record={"/plan": "nav_msgs/Path"}), 3, -0.5, 0.5, 6.0)


class Answers:
    """Applications that command 0.1 m/s more in every second step."""

    failures: Mapping[int, str] = {}
    cancelled = frozenset[int]()
    tests: Mapping[int, bool] = {}
    goal_ends: Mapping[int, GoalEnd] = {}
    placed: Mapping[int, tuple[float, float, float]] = {}

    def __init__(self) -> None:
        self.steps, self.closed = 0, False

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        assert len(floors) == len(sensed)
        self.exchange(sensed)  # warms up
        self.steps = 0

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        self.steps += 1
        return [TwistCommand(0.1 * (self.steps // 2))] * len(sensed)

    def tally(self, lane: int) -> ExchangeTotals:
        return ExchangeTotals(commands=self.steps // 2 + lane)

    def heard(self, lane: int) -> Sequence[tuple[str, bytes]]:
        return [("/plan", b"plan")] if lane == 0 and self.steps % 2 else []

    def simulation_failed(self, lane: int) -> bool:
        return lane < 0

    def tags(self, lane: int) -> Mapping[str, str]:
        return {"lane": str(lane)}

    def printed(self, lane: int) -> str:
        return f"lane {lane}"

    def close(self) -> None:
        self.closed = True


def sensed(x_m: float) -> Sensed:
    still = np.zeros(3)
    return Sensed(np.array([x_m, 0.0, 0.0]), still, np.zeros(2), np.ones(3), np.zeros(0, bool), np.array([2.0, 0.0]))


@pytest.fixture(scope="module")
def kept() -> MessageLog:
    traffic = LockstepRecorder(Answers(), BASE, 0.05)
    traffic.begin([sensed(0.0)], [None])
    for step in range(4):
        traffic.exchange([sensed(0.1 * step)])
    traffic.exchange([None])  # it is done, and others are not
    traffic.close()
    return traffic.log()


def test_each_step_has_what_the_robot_senses_and_the_goal_is_said_once(kept: MessageLog):
    counts = {channel.topic: len(of_topic(kept, channel.topic)) for channel in kept.channels}
    assert counts["/odom"] == counts["/scan"] == counts["/clock"] == counts["/imu"] == 4
    assert (counts["/move_base_simple/goal"], counts["/tf_static"]) == (1, 1)


def test_commands_are_kept_when_they_came(kept: MessageLog):
    found = [(entry.time_ns, struct.unpack("<6d", entry.body)[0]) for entry in of_topic(kept, "/cmd_vel")]
    assert found == [(1_050_000_000, pytest.approx(0.1)), (1_150_000_000, pytest.approx(0.2))]


def test_what_nodes_said_is_kept_at_the_time_of_its_step(kept: MessageLog):
    assert [entry.time_ns for entry in of_topic(kept, "/plan")] == [1_000_000_000, 1_100_000_000, 1_200_000_000]
    assert {channel.topic: channel.kind for channel in kept.channels}["/plan"] == "nav_msgs/Path"


def test_times_begin_at_a_second_and_never_go_back(kept: MessageLog):
    times = [entry.time_ns for entry in kept.entries]
    assert times == sorted(times)
    assert times[0] == 1_000_000_000


def test_it_is_a_lock_step_like_the_one_behind_it():
    answers = Answers()
    traffic = LockstepRecorder(answers, BASE, 0.05)
    assert (traffic.failures, traffic.cancelled, traffic.tags(3)) == ({}, frozenset(), {"lane": "3"})
    traffic.close()
    assert answers.closed


def test_a_log_gets_the_topics_of_another_that_it_lacks(kept: MessageLog):
    both = with_other_topics(kept, log())
    assert of_topic(both, "/odom") == of_topic(kept, "/odom")
    assert of_topic(both, "/simyard/control") == of_topic(log(), "/simyard/control")
    times = [entry.time_ns for entry in both.entries]
    assert times == sorted(times)
    assert len({channel.topic for channel in both.channels}) == len(both.channels)
    assert isinstance(next(iter(both.entries)), LogEntry)
