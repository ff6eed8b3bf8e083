"""Lanes that take long within a control step, by what the kernel might tell of their threads."""

import socket
import time
from collections.abc import Callable, Iterator

import pytest

from tasks.ros.graph.event_loop import Connection, EventLoop
from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import Subscriber
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import CLOCK
from tasks.ros.lockstep.ros_lane import EventPump, RosLane
from tasks.ros.lockstep.step_driver import LockstepPatience, StepDriver
from tasks.ros.process.lane_limits import LaneLimits
from tasks.ros.process.network import EpisodeNetwork
from tests.ros.process.proc_folder import FakeThread

PATIENCE = LockstepPatience(stage_s=0.3, nap_s=0.15)
LONG_S = 1.5 * PATIENCE.stage_s


class BusyPump(EventPump):
    """Naps in which a thread is awake until it has taken longer than it may, and until something is so.

    Args:
        thread: Awake.
        waited_ns: As long as it waited for a core before the first nap.
        until: Tells what.
    """

    def __init__(self, thread: FakeThread, waited_ns: int, until: Callable[[], bool] = lambda: True) -> None:
        super().__init__()
        self._until = until
        self._thread, self._waited_ns = thread, waited_ns
        self._ends_s = 0.0
        thread.be("R")

    def nap(self, seconds: float) -> bool:
        """Waits, as any pump does."""
        if not self._ends_s:
            self._ends_s = time.perf_counter() + LONG_S
            self._thread.run(waited_ns=self._waited_ns)
            self._thread.be("R")
        elif self._thread.state == "R" and time.perf_counter() > self._ends_s and self._until():
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


def late(lane: RosLane, pump: EventPump) -> int:
    """Returns how many stages of the lane were late."""
    StepDriver(pump, PATIENCE, lambda lane: pytest.fail(lane.failure)).run([lane], 0)
    pump.close()
    return lane.late


def test_a_lane_that_takes_too_long_is_late(lane: RosLane, worker: FakeThread) -> None:
    assert late(lane, BusyPump(worker, 0, until=lambda: lane.late > 0)) == 1


def test_a_lane_whose_thread_waited_for_a_core_is_not_late(lane: RosLane, worker: FakeThread) -> None:
    assert late(lane, BusyPump(worker, 60_000_000_000)) == 0


@pytest.mark.parametrize("limits", [LaneLimits(memory_bytes=1)], ids=["memory"])
def test_a_lane_beyond_its_limits_ends_within_the_control_step(lane: RosLane, worker: FakeThread) -> None:
    ended: list[str] = []
    pump = BusyPump(worker, 0, until=lambda: bool(ended))
    StepDriver(pump, PATIENCE, lambda lane: ended.append(lane.failure)).run([lane], 0)
    pump.close()
    assert len(ended) == 1
    assert "of memory: more than the 0 MiB that it may" in ended[0]
