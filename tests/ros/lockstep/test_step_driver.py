"""Lanes that take long within a control step, by what the kernel might tell of their threads."""

import os
import socket
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest

from tasks.ros.graph.event_loop import Connection, EventLoop
from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import Subscriber
from tasks.ros.lockstep import step_driver
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import CLOCK
from tasks.ros.lockstep.ros_lane import EventPump, RosLane
from tasks.ros.lockstep.step_driver import LockstepPatience, Readiness, StepDriver
from tasks.ros.process.lane_limits import LaneLimits
from tasks.ros.process.network import EpisodeNetwork
from tests.ros.process.proc_folder import FakeThread

PATIENCE = LockstepPatience(stage_s=0.3, nap_s=0.15)
LONG_S = 1.5 * PATIENCE.stage_s


class TimedPump(EventPump):
    """Time passes while it naps, and at no other moment.

    Attributes:
        now_s: The time.
    """

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def nap(self, seconds: float) -> bool:
        """Lets time pass."""
        self.now_s += seconds
        return False


class BusyPump(TimedPump):
    """Naps in which a thread is awake until it has taken longer than it may, and until something is so.

    How busy this machine is plays no part.

    Args:
        thread: Awake.
        ran_ns: As long as it ran before the first nap; else it waits for a core.
        until: Tells what.
    """

    def __init__(self, thread: FakeThread, ran_ns: int, until: Callable[[], bool] = lambda: True) -> None:
        super().__init__()
        self._until = until
        self._thread, self._ran_ns = thread, ran_ns
        thread.be("R")

    def nap(self, seconds: float) -> bool:
        """Lets time pass."""
        if not self.now_s:
            self._thread.run(ran_ns=self._ran_ns)
            self._thread.be("R")
        elif self._thread.state == "R" and self.now_s > LONG_S and self._until():
            self._thread.run()
        return super().nap(seconds)


@pytest.fixture
def lane(detector: IdleDetector, pump: EventPump) -> Iterator[RosLane]:
    """A lane with a tick to be sent, and a node that is connected and never reads."""
    ours, theirs = socket.socketpair()
    channel = Connection(EventLoop(pump.loop, socket.socket), ours, lambda: None, lambda: None)
    assert isinstance(detector.graph, Graph)
    detector.graph.outgoing[CLOCK].append(Subscriber("/node", channel))
    found = RosLane(detector, EpisodeNetwork(socket.socket, ()), pump, frozenset())
    found.plan([(CLOCK, lambda: b"tick")])
    yield found
    theirs.close()
    ours.close()


Drive = Callable[[BusyPump, Callable[[RosLane], None]], None]


@pytest.fixture
def drive(lane: RosLane, monkeypatch: pytest.MonkeyPatch) -> Drive:
    """Brings the lane through a control step, by the time of its pump."""

    def run(pump: BusyPump, fail: Callable[[RosLane], None]) -> None:
        monkeypatch.setattr(step_driver, "time", SimpleNamespace(perf_counter=lambda: pump.now_s))
        StepDriver(pump, PATIENCE, fail).run([lane], 0)
        pump.close()

    return run


def no_fault(lane: RosLane) -> None:
    pytest.fail(lane.failure)


def test_a_lane_that_takes_too_long_is_late_and_the_log_says_after_what_and_why(
    lane: RosLane, worker: FakeThread, drive: Drive, caplog: pytest.LogCaptureFixture
) -> None:
    drive(BusyPump(worker, 60_000_000_000, until=lambda: lane.late > 0), no_fault)
    assert lane.late == 1
    (told,) = caplog.messages
    assert "did not come to rest within" in told
    assert f"after {CLOCK} was sent: process {os.getpid()}, thread {worker.folder.name}: runs" in told


def test_a_lane_with_a_stopped_process_that_never_seems_at_rest_fails_with_that_reason(
    lane: RosLane, worker: FakeThread, poller: FakeThread, drive: Drive
) -> None:
    poller.be("T")
    drive(BusyPump(worker, 60_000_000_000, until=lambda: bool(lane.failure)), lambda _: None)
    assert lane.failure == "a process was stopped by a signal"


def test_a_lane_whose_thread_waited_for_a_core_is_not_late(lane: RosLane, worker: FakeThread, drive: Drive) -> None:
    drive(BusyPump(worker, 0), no_fault)
    assert lane.late == 0


def test_a_lane_that_is_connected_and_does_not_begin_says_what_is_missing(lane: RosLane, pump: EventPump) -> None:
    Readiness(pump, "/cmd_vel", 0.0, lambda _: None).wait([lane])
    assert lane.failure == "not ready within 0 s: its nodes did not come to rest, and none of them publishes /cmd_vel"


def test_a_lane_that_does_not_begin_says_what_its_nodes_publish_in_vain(
    lane: RosLane, pump: EventPump, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane.graph, "gaps", lambda: ["/roam publishes it elsewhere"])
    Readiness(pump, "/cmd_vel", 0.0, lambda _: None).wait([lane])
    assert lane.failure.endswith(", and none of them publishes /cmd_vel; /roam publishes it elsewhere")


def test_a_lane_whose_nodes_go_by_the_walls_clock_says_so(lane: RosLane, pump: EventPump) -> None:
    assert isinstance(lane.graph, Graph)
    lane.graph.outgoing[CLOCK].clear()
    Readiness(pump, "/cmd_vel", 0.0, lambda _: None).wait([lane])
    assert lane.failure.endswith(", and none reads /clock: use_sim_time: true is for that")


@pytest.mark.parametrize(("waited_s", "ends_s"), [(0, 10.0), (7, 17.0), (1000, 50.0)])
def test_a_lane_has_longer_to_be_ready_where_others_have_the_cores(
    lane: RosLane, worker: FakeThread, monkeypatch: pytest.MonkeyPatch, waited_s: int, ends_s: float
) -> None:
    pump = TimedPump()
    clock = SimpleNamespace(perf_counter=lambda: pump.now_s, sleep=lambda _: None)
    monkeypatch.setattr(step_driver, "time", clock)
    monkeypatch.setattr(step_driver, "own_wait_s", lambda: waited_s * (pump.now_s > 1.0))
    worker.be("R")
    Readiness(pump, "/cmd_vel", 10.0, lambda _: None).wait([lane])
    pump.close()
    assert lane.failure.startswith("not ready within 10 s: its nodes did not come to rest")
    assert pump.now_s == pytest.approx(ends_s, abs=0.1)


@pytest.mark.parametrize("limits", [LaneLimits(memory_bytes=1)], ids=["memory"])
def test_a_lane_beyond_its_limits_ends_within_the_control_step(worker: FakeThread, drive: Drive) -> None:
    ended: list[str] = []
    drive(BusyPump(worker, 0, until=lambda: bool(ended)), lambda lane: ended.append(lane.failure))
    assert len(ended) == 1
    assert "of memory: more than the 0 MiB that it may" in ended[0]
