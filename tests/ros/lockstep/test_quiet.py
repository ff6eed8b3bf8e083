"""When an application is quiet, by what the kernel might tell of its threads; the times are the test's own."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.ros.graph.graph import Graph
from tasks.ros.lockstep.event_pump import EventPump
from tasks.ros.lockstep.quiet import QuietJudge, Verdict
from tasks.ros.process.application import Application
from tasks.ros.process.lane_limits import LaneLimits
from tasks.ros.process.lineage import Lineage
from tasks.ros.process.thread_watch import ThreadWatch
from tests.ros.process.proc_folder import FakeThread, fake_thread

WORKER, POLLER = 2**22 + 1, 2**22 + 2
PERIOD_S = 0.001


@pytest.fixture
def proc(tmp_path: Path) -> Path:
    return tmp_path / "proc"


@pytest.fixture
def worker(proc: Path) -> FakeThread:
    """A thread that answers what is sent to it."""
    return fake_thread(proc, os.getpid(), WORKER)


@pytest.fixture
def poller(proc: Path) -> FakeThread:
    """A thread that polls, once it is ``known``."""
    return fake_thread(proc, os.getpid(), POLLER)


@pytest.fixture
def judge(proc: Path, worker: FakeThread, poller: FakeThread) -> Iterator[QuietJudge]:
    """Judges an application of these two threads."""
    pump, lineage = EventPump(), Lineage()
    application = Application(proc.parent, lineage, LaneLimits())
    application.watch = ThreadWatch(proc)
    lineage.add(os.getpid(), proc.parent)
    application.find()
    graph = Graph(pump.loop, (), ())
    yield QuietJudge(application, graph, 1.0)
    graph.close()
    application.watch.close()
    lineage.close()
    pump.close()


def known(judge: QuietJudge, poller: FakeThread) -> None:
    """Lets the judge learn who polls, before anything is sent."""
    judge.count(0.0)
    poller.run(300)
    judge.find_pollers(0.3)
    assert judge.pollers == {POLLER: pytest.approx(PERIOD_S)}


def send(judge: QuietJudge, worker: FakeThread, now_s: float) -> None:
    """Sends something that the worker deals with: only the poller is still waited for."""
    judge.begin(now_s, fresh=False, ticked=True)
    worker.run()
    assert judge.look(now_s + 0.001) is Verdict.SOON
    assert judge.look(now_s + 0.002) is Verdict.WAITS


def test_an_application_is_quiet_once_its_poller_has_looked_again(
    judge: QuietJudge, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    poller.run()
    assert judge.look(1.003) is Verdict.WAITS
    assert judge.look(1.004) is Verdict.QUIET


def test_a_poller_that_waits_for_a_core_is_waited_for(
    judge: QuietJudge, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    poller.be("R")
    assert judge.look(1.5) is Verdict.WAITS
    assert POLLER in judge.pollers
    poller.run()
    assert judge.look(1.501) is Verdict.WAITS
    assert judge.look(1.502) is Verdict.QUIET


def test_a_poller_that_sleeps_on_is_given_up(judge: QuietJudge, worker: FakeThread, poller: FakeThread) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    assert judge.look(1.1) is Verdict.QUIET
    assert judge.pollers == {}


def test_a_poller_that_was_given_up_is_taken_back_when_it_polls_again(
    judge: QuietJudge, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    assert judge.look(1.1) is Verdict.QUIET
    judge.begin(1.101, fresh=True, ticked=True)
    worker.run()
    verdicts: list[Verdict] = []
    for millisecond in range(102, 110):
        poller.run()
        verdicts.append(judge.look(1.0 + PERIOD_S * millisecond))
    assert judge.pollers == {POLLER: pytest.approx(PERIOD_S)}
    assert Verdict.QUIET in verdicts


def test_a_thread_that_is_given_up_again_and_again_is_taken_back_later(
    judge: QuietJudge, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    now_s, needed = 1.0, list[int]()
    for _ in range(6):
        send(judge, worker, now_s)
        assert judge.look(now_s + 0.1) is Verdict.QUIET
        polls = 0
        while not judge.pollers and polls < 100:
            poller.run()
            polls += 1
            judge.look(now_s + 0.1 + PERIOD_S * polls)
        needed.append(polls)
        now_s += 1.0
    assert needed == [4, 8, 16, 32, 64, 64]
