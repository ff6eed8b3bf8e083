"""An application whose threads are what a test says of them."""

import os
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import Topic
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import CLOCK
from tasks.ros.lockstep.ros_lane import EventPump
from tasks.ros.process.application_processes import ApplicationProcesses, ProcessTracker
from tasks.ros.process.lane_limits import LaneLimits
from tasks.ros.process.nap_gate import HeldNap, NapGate
from tasks.ros.process.thread_watch import ThreadWatch
from tests.ros.process.proc_folder import FakeThread, fake_thread

WORKER, POLLER = 2**22 + 1, 2**22 + 2
# The process that stands for a node is the one of these tests, which may take more than any node.
ENDLESS = LaneLimits(memory_bytes=2**60, processes=2**30)


class FakeGate(NapGate):
    """Holds the naps that a test says.

    Attributes:
        ended: Whose naps ended, one after the other.
    """

    def __init__(self) -> None:
        super().__init__()
        self.ended: list[int] = []

    def hold_nap(self, tid: int) -> None:
        self.held[tid] = HeldNap((0, tid), -1, 0)

    def end(self, tid: int) -> None:
        del self.held[tid]
        self.ended.append(tid)


@pytest.fixture
def gate() -> FakeGate:
    return FakeGate()


@pytest.fixture
def proc(tmp_path: Path) -> Path:
    return tmp_path / "proc"


@pytest.fixture
def worker(proc: Path) -> FakeThread:
    """A thread that answers what is sent to it."""
    return fake_thread(proc, os.getpid(), WORKER)


@pytest.fixture
def looker(proc: Path) -> FakeThread:
    """The thread that looks, where it is told of before it does so first."""
    found = FakeThread(proc / "thread-self")
    found.be("S")
    return found


@pytest.fixture
def poller(proc: Path) -> FakeThread:
    """A thread that polls, once it is ``known``."""
    return fake_thread(proc, os.getpid(), POLLER)


@pytest.fixture
def pump() -> Iterator[EventPump]:
    found = EventPump()
    yield found
    found.close()


@pytest.fixture
def limits() -> LaneLimits:
    return ENDLESS


@pytest.fixture
def detector(
    pump: EventPump, proc: Path, worker: FakeThread, poller: FakeThread, limits: LaneLimits, *, gate: FakeGate
) -> Iterator[IdleDetector]:
    """Judges an application of these two threads, to which nobody is connected."""
    with detector_of(proc, pump, limits, gate) as found:
        yield found


@contextmanager
def detector_of(
    proc: Path, pump: EventPump, limits: LaneLimits = ENDLESS, gate: NapGate | None = None
) -> Generator[IdleDetector]:
    """Judges an application of the threads that are in a folder, to which nobody is connected."""
    tracker = ProcessTracker()
    application = ApplicationProcesses(proc.parent, tracker, limits, gate)
    application.watch = ThreadWatch(proc)
    tracker.add(os.getpid(), proc.parent)
    application.find()
    graph = Graph(pump.loop, (Topic(CLOCK, "rosgraph_msgs/Clock"),), ())
    yield IdleDetector(application, graph, 1.0)
    graph.close()
    application.watch.close()
    tracker.close()
