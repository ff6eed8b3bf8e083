"""What a robot publishes, by what it has and how it is declared, and what a recorder keeps of it."""

import math
import struct
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from specs.bundle_files import BumperDeclaration, LidarDeclaration, RosRobot, RosTopics
from tasks.ros.bag.message_log import LogEntry, MessageLog, with_other_topics
from tasks.ros.lockstep.exchange import ExchangeTotals, FloorMap, GoalEnd, RobotBase, Sensed, TwistCommand
from tasks.ros.lockstep.robot_topics import NAVIGATE, LockstepRecorder, Moment, SensorMessages
from tests.ros.bag.tracks import log, of_topic

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
