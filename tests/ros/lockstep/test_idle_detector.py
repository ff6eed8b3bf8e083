"""When an application is quiet, by what the kernel might tell of its threads; the times are the test's own."""

import pytest

from tasks.ros.lockstep.idle_detector import IdleDetector, Verdict
from tests.ros.lockstep.conftest import POLLER
from tests.ros.process.proc_folder import FakeThread

PERIOD_S = 0.001


def known(judge: IdleDetector, poller: FakeThread) -> None:
    """Lets the judge learn who polls, before anything is sent."""
    judge.count(0.0)
    poller.run(300)
    judge.find_pollers(0.3)
    assert judge.pollers == {POLLER: pytest.approx(PERIOD_S)}


def send(judge: IdleDetector, worker: FakeThread, now_s: float) -> None:
    """Sends something that the worker deals with: only the poller is still waited for."""
    judge.begin(now_s, fresh=False, ticked=True)
    worker.run()
    assert judge.look(now_s + 0.001) is Verdict.SOON
    assert judge.look(now_s + 0.002) is Verdict.WAITS


def give_up(judge: IdleDetector, worker: FakeThread, poller: FakeThread) -> None:
    """Lets the poller sleep on after a message, until the judge waits for it no more."""
    known(judge, poller)
    send(judge, worker, 1.0)
    assert judge.look(1.1) is Verdict.QUIET


def test_an_application_is_quiet_once_its_poller_has_looked_again(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    poller.run()
    assert judge.look(1.003) is Verdict.WAITS
    assert judge.look(1.004) is Verdict.QUIET


def test_a_poller_that_waits_for_a_core_is_waited_for(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(judge, poller)
    send(judge, worker, 1.0)
    poller.be("R")
    assert judge.look(1.5) is Verdict.WAITS
    assert POLLER in judge.pollers
    poller.run()
    assert judge.look(1.501) is Verdict.WAITS
    assert judge.look(1.502) is Verdict.QUIET


def test_a_poller_that_sleeps_on_is_given_up(judge: IdleDetector, worker: FakeThread, poller: FakeThread) -> None:
    give_up(judge, worker, poller)
    assert judge.pollers == {}


def test_a_poller_that_was_given_up_is_taken_back_when_it_polls_again(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    give_up(judge, worker, poller)
    judge.begin(1.101, fresh=True, ticked=True)
    worker.run()
    verdicts: list[Verdict] = []
    for millisecond in range(102, 110):
        poller.run()
        verdicts.append(judge.look(1.0 + PERIOD_S * millisecond))
    assert judge.pollers == {POLLER: pytest.approx(PERIOD_S)}
    assert Verdict.QUIET in verdicts


def test_a_poller_that_slept_for_a_minute_is_taken_back_as_soon(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    give_up(judge, worker, poller)
    judge.begin(61.0, fresh=False, ticked=True)
    worker.run()
    for millisecond in range(1, 12):
        poller.run()
        judge.look(61.0 + PERIOD_S * millisecond)
    assert judge.pollers == {POLLER: pytest.approx(PERIOD_S)}


def test_a_thread_that_is_given_up_again_and_again_is_taken_back_later(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
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


def test_what_a_thread_waits_for_a_core_is_no_time_of_the_application(
    judge: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    judge.begin(1.0, fresh=False, ticked=True)
    worker.run(waited_ns=1_500_000_000)
    assert judge.has_time(2.0, 4.4)
    assert not judge.has_time(2.0, 4.6)


def test_waits_of_two_threads_are_not_added_up(judge: IdleDetector, worker: FakeThread, poller: FakeThread) -> None:
    judge.begin(1.0, fresh=False, ticked=True)
    worker.run(waited_ns=1_500_000_000)
    poller.run(waited_ns=1_000_000_000)
    assert judge.has_time(2.0, 4.4)
    assert not judge.has_time(2.0, 4.6)


def test_waits_before_something_was_sent_do_not_count(judge: IdleDetector, worker: FakeThread) -> None:
    worker.run(waited_ns=9_000_000_000)
    judge.begin(1.0, fresh=False, ticked=True)
    assert judge.has_time(2.0, 2.9)
    assert not judge.has_time(2.0, 3.1)


def test_waits_before_a_message_that_follows_a_late_one_do_not_count(judge: IdleDetector, worker: FakeThread) -> None:
    judge.begin(1.0, fresh=False, ticked=True)
    worker.run(waited_ns=9_000_000_000)
    worker.be("R")
    assert judge.look(2.0) is Verdict.AWAKE
    judge.begin(2.1, fresh=True, ticked=True)
    assert judge.has_time(2.0, 4.0)
    assert not judge.has_time(2.0, 4.2)


def test_a_limit_ends_after_five_times_as_long_however_long_a_thread_waits(
    judge: IdleDetector, worker: FakeThread
) -> None:
    judge.begin(1.0, fresh=False, ticked=True)
    worker.run(waited_ns=100_000_000_000)
    assert judge.has_time(2.0, 10.9)
    assert not judge.has_time(2.0, 11.1)


def test_a_callback_may_nap_for_longer_if_it_waits_for_a_core(judge: IdleDetector, worker: FakeThread) -> None:
    judge.begin(1.0, fresh=False, ticked=True)
    worker.run(waited_ns=500_000_000)
    worker.nap()
    judge.look(1.1)
    assert judge.look(2.4) is Verdict.WAITS
    assert judge.look(2.6) is Verdict.QUIET
