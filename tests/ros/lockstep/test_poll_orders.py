"""Threads that poll for what other threads do: nobody is at rest while one of them is still to find something.

The threads are fakes here, and time is the test's own.
"""

import itertools
import math
import os
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.ros.lockstep.idle_detector import IdleDetector, IdleState, PollOrders
from tasks.ros.lockstep.ros_lane import EventPump
from tests.ros.lockstep.conftest import POLLER, WORKER, detector_of
from tests.ros.process.proc_folder import FakeThread, fake_thread

_LOOK_S = 0.00005
_LONGEST_S = 5.0


class Poller(NamedTuple):
    """A thread that polls: what it finds, it hands to the next one.

    Attributes:
        period_s: How long it sleeps in between.
        phase: How much of that is over when the application is sent something.
    """

    period_s: float
    phase: float


class Chain:
    """A worker that is sent something, and pollers that hand it on, one to the next, in the time of a test.

    Args:
        proc: Where the kernel would tell of them.
        pollers: In the order in which they hand it on.
    """

    def __init__(self, proc: Path, pollers: list[Poller]) -> None:
        self._pollers = pollers
        self._worker = fake_thread(proc, os.getpid(), WORKER)
        self._threads = [fake_thread(proc, os.getpid(), POLLER + number) for number in range(len(pollers))]
        self.found = 0

    def idle(self, detector: IdleDetector) -> None:
        """Lets them poll for a second in which nothing is to be found."""
        detector.count(0.0)
        for thread, (period_s, _) in zip(self._threads, self._pollers, strict=True):
            ran_ns = thread.ran_ns
            thread.run(round(1.0 / period_s))
            thread.ran_ns = ran_ns + 1000 * round(1.0 / period_s)
            thread.be("S")
        detector.find_pollers(1.0)

    def send(self, detector: IdleDetector, now_s: float) -> None:
        """Sends something, and looks until the application is taken to be at rest."""
        detector.begin(now_s, fresh=False, ticked=True)
        self._worker.run()
        next_s = [now_s + (1.0 - phase) * period_s for period_s, phase in self._pollers]
        ends_s, look_s, self.found = now_s + _LONGEST_S, now_s, 0
        while look_s < ends_s:
            self._run(next_s, look_s)
            verdict = detector.look(look_s)
            if verdict is IdleState.QUIET:
                return
            look_s = max(look_s + _LOOK_S, detector.next_s if verdict is IdleState.WAITS else 0.0)
        pytest.fail("they never come to rest")

    def _run(self, next_s: list[float], now_s: float) -> None:
        """Lets those poll whose time has come until now, one after the other."""
        while min(next_s) <= now_s:
            number = next_s.index(min(next_s))
            self._threads[number].run()
            self.found += number == self.found
            next_s[number] += self._pollers[number].period_s


pollers = st.builds(Poller, st.floats(0.0002, 0.02), st.floats(0.0, 0.99))


def found_by(chain: list[Poller]) -> int:
    """Returns how many of a chain had found what was sent when they were taken to be at rest."""
    pump = EventPump()
    with tempfile.TemporaryDirectory() as folder:
        threads = Chain(Path(folder) / "proc", chain)
        with detector_of(Path(folder) / "proc", pump) as detector:
            threads.idle(detector)
            threads.send(detector, 2.0)
    pump.close()
    return threads.found


def test_nobody_is_at_rest_before_the_last_poller_of_a_chain_has_found_what_was_sent() -> None:
    assert found_by([Poller(0.0078, 0.125), Poller(0.002, 0.0)]) == 2


@pytest.mark.long
@settings(max_examples=20, deadline=None)
@given(st.lists(pollers, min_size=1, max_size=5))
def test_any_chain_of_pollers_has_found_what_was_sent_when_it_is_taken_to_be_at_rest(chain: list[Poller]) -> None:
    assert found_by(chain) == len(chain)


def known(detector: IdleDetector, thread: FakeThread, period_s: float = 0.001) -> None:
    """Lets the detector learn that a thread polls."""
    detector.count(0.0)
    thread.run(round(1.0 / period_s))
    detector.find_pollers(1.0)
    assert POLLER in detector.pollers


def test_a_poller_of_a_process_in_which_nobody_else_ran_is_not_waited_for(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    detector.begin(2.0, fresh=False, ticked=True)
    detector.look(2.021)
    assert detector.look(2.022) is IdleState.QUIET


def test_a_poller_that_waits_for_what_comes_is_waited_for_once_another_process_may_have_sent_it(
    proc: Path, detector: IdleDetector, worker: FakeThread, poller: FakeThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    known(detector, poller)
    poller.waits_at = "do_epoll_wait"
    poller.be("S")
    other = fake_thread(proc, 1, POLLER + 1)
    monkeypatch.setattr(detector.application, "find", lambda: None)  # which knows nothing of the other process
    detector.application.watch.refresh([os.getpid(), 1])
    detector.begin(2.0, fresh=False, ticked=True)
    worker.run()
    assert [detector.look(2.001), detector.look(2.002)] == [IdleState.SOON, IdleState.WAITS]
    other.be("R")
    poller.run()
    assert detector.look(2.003) is IdleState.AWAKE
    other.run()
    assert detector.look(2.004) is IdleState.SOON
    assert {detector.look(2.005 + 0.001 * k) for k in range(3)} == {IdleState.WAITS}
    poller.run()
    assert [detector.look(2.008), detector.look(2.009)] == [IdleState.WAITS, IdleState.QUIET]


def test_a_poll_that_ran_for_long_found_something_and_is_waited_for_once_more(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    detector.begin(2.0, fresh=False, ticked=True)
    worker.run()
    assert [detector.look(2.001), detector.look(2.002)] == [IdleState.SOON, IdleState.WAITS]
    poller.ran_ns += 5_000_000
    poller.run()
    assert {detector.look(2.0 + 0.001 * k) for k in range(3, 20)} == {IdleState.WAITS}
    poller.run()
    assert [detector.look(2.021), detector.look(2.022)] == [IdleState.WAITS, IdleState.QUIET]


def test_a_poller_that_naps_in_its_work_may_nap_as_long_as_a_callback(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    poller.nap()
    detector.begin(2.0, fresh=False, ticked=True)
    worker.run()
    detector.look(2.001)
    assert {detector.look(2.0 + 0.01 * k) for k in range(1, 99)} == {IdleState.WAITS}
    assert {detector.look(2.0 + 0.01 * k) for k in range(99, 104)} != {IdleState.WAITS}
    assert POLLER not in detector.pollers


# A call of futex(2) that waits on a condition: its number, an address, what to do, a value, until when.
@pytest.mark.parametrize(
    ("call", "waited_for"),
    [("202 0x7f0 0x189 0x0 0x7f8", True), ("202 0x7f0 0x189 0x0 0x0", False), ("running", True), ("", False)],
)
def test_a_poller_that_sleeps_until_a_time_polls_again_though_it_is_late(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread, call: str, *, waited_for: bool
) -> None:
    """One whose core the machine's owner gave to others was given up, and its command came later or was lost."""
    known(detector, poller)
    poller.call = call
    poller.be("S")
    detector.begin(2.0, fresh=False, ticked=True)
    worker.run()
    detector.look(2.001)
    assert ({detector.look(2.0 + 0.01 * k) for k in range(1, 90)} == {IdleState.WAITS}) is waited_for
    assert (POLLER in detector.pollers) is waited_for


def test_a_poller_that_lost_its_core_within_a_look_has_not_looked_again(
    proc: Path, detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    """It is run once more for the same look, and had read before that what another poller changed meanwhile."""
    other = fake_thread(proc, os.getpid(), POLLER + 1)
    detector.application.watch.refresh([os.getpid()])
    detector.count(0.0)
    for each in (poller, other):
        each.run(1000)
    detector.find_pollers(1.0)
    detector.begin(2.0, fresh=False, ticked=True)
    worker.run()
    other.runs += 1
    other.be("R")
    looks = [detector.look(2.001), detector.look(2.002)]
    for number, each in enumerate((poller, other, poller)):  # so the other one's look is the one that it began with
        each.run()
        looks.append(detector.look(2.003 + 0.001 * number))
    assert {*looks[1:], detector.look(2.006)} == {IdleState.WAITS}
    for number, each in enumerate((other, poller)):
        each.run()
        looks.append(detector.look(2.007 + 0.001 * number))
    assert [looks[-1], detector.look(2.009)] == [IdleState.WAITS, IdleState.QUIET]


def test_two_threads_that_begin_to_poll_in_a_stage_are_found_in_it(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    detector.begin(2.0, fresh=False, ticked=True)
    for each in (worker, poller):
        each.nap()
    verdicts: list[IdleState] = []
    for number in range(1, 150):
        for each in (worker, poller):
            each.run()
        verdicts.append(detector.look(2.0 + 0.01 * number))
    assert IdleState.QUIET in verdicts
    assert detector.pollers.keys() == {WORKER, POLLER}


def test_what_it_took_to_find_that_a_thread_polls_is_no_time_of_the_application(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    detector.begin(2.0, fresh=False, ticked=True)
    poller.nap()
    for number in range(1, 120):
        worker.ran_ns += 1_000_000
        worker.run()
        poller.run()
        detector.look(2.0 + 0.01 * number)
    assert detector.pollers.keys() == {POLLER}
    poller.be("S")
    for number in range(120, 290):
        worker.run()
        detector.look(2.0 + 0.01 * number)
    assert detector.has_time(2.0, 4.9)
    for number in range(290, 310):
        worker.run()
        detector.look(2.0 + 0.01 * number)
    assert not detector.has_time(2.0, 5.1)


def test_threads_that_wake_each_tenth_of_a_second_one_after_the_other_do_not_begin_everything_anew(
    proc: Path, pump: EventPump, worker: FakeThread, poller: FakeThread
) -> None:
    seldom = [fake_thread(proc, os.getpid(), POLLER + 1 + number) for number in range(10)]
    with detector_of(proc, pump) as detector:
        known(detector, poller, 0.012)
        detector.begin(2.0, fresh=False, ticked=True)
        worker.run()
        verdicts: list[IdleState] = []
        for number in range(1, 450):
            if number % 6 == 0:
                poller.run()
            if number % 5 == 0:
                seldom[number // 5 % 10].run()
            verdicts.append(detector.look(2.0 + 0.002 * number))
    assert IdleState.QUIET in verdicts


def test_threads_that_wake_seldom_are_known_to_who_looks_seldom_because_others_have_the_cores(
    proc: Path, pump: EventPump, worker: FakeThread, poller: FakeThread
) -> None:
    seldom = [fake_thread(proc, os.getpid(), POLLER + 1 + number) for number in range(10)]

    def look(detector: IdleDetector, before_s: float, now_s: float) -> IdleState:
        for number, each in enumerate(seldom):  # the first one wakes each full tenth of a second
            if math.floor(10 * now_s - 0.1 * number) > math.floor(10 * before_s - 0.1 * number):
                each.run()
        poller.run()
        return detector.look(now_s)

    with detector_of(proc, pump) as detector:
        known(detector, poller, 0.012)
        for begun_s, looks_s in ((2.0, [0.002] * 250), (2.5, [0.011, 0.058] * 15)):
            detector.begin(begun_s, fresh=False, ticked=True)
            worker.run()
            ends_s = [begun_s + sum(looks_s[: number + 1]) for number in range(len(looks_s))]
            verdicts = [look(detector, *each) for each in itertools.pairwise([begun_s, *ends_s])]
            assert IdleState.QUIET in verdicts


@pytest.mark.parametrize("polled", [[1, 2, 3] * 3, [3, 2, 1] * 3, [3, 1, 2, 3, 1, 2, 3]])
def test_pollers_have_polled_in_every_order_and_not_before(polled: list[int]) -> None:
    orders = PollOrders([1, 2, 3])
    seen: list[bool] = []
    for tid in polled:
        orders.add({tid})
        seen.append(orders.all_seen)
    assert seen.index(True) == 6


def test_many_pollers_poll_as_often_as_there_are_of_them() -> None:
    orders = PollOrders(range(100))
    for _ in range(99):
        orders.add(set(range(100)))
        assert not orders.all_seen
    orders.add(set(range(100)))
    assert orders.all_seen
