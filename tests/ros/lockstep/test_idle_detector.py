"""When an application is quiet, by what the kernel might tell of its threads; the times are the test's own."""

import itertools
import os

import pytest

from tasks.ros.graph.graph import Graph
from tasks.ros.lockstep.idle_detector import IdleDetector, IdleState
from tasks.ros.process import thread_watch
from tasks.ros.process.nap_gate import HeldNap
from tests.ros.lockstep.conftest import POLLER, WORKER, FakeGate
from tests.ros.process.proc_folder import FakeThread

PERIOD_S = 0.001


def known(detector: IdleDetector, poller: FakeThread) -> None:
    """Lets the detector learn who polls, before anything is sent."""
    detector.count(0.0)
    poller.run(300)
    detector.find_pollers(0.3)
    assert detector.pollers == {POLLER: pytest.approx(PERIOD_S)}


def send(detector: IdleDetector, worker: FakeThread, now_s: float) -> None:
    """Sends something that the worker deals with: only the poller is still waited for."""
    detector.begin(now_s, fresh=False, ticked=True)
    worker.run()
    assert detector.look(now_s + 0.001) is IdleState.SOON
    assert detector.look(now_s + 0.002) is IdleState.WAITS


def give_up(detector: IdleDetector, worker: FakeThread, poller: FakeThread) -> None:
    """Lets the poller sleep on after a message, until the detector waits for it no more."""
    known(detector, poller)
    send(detector, worker, 1.0)
    assert detector.look(1.1) is IdleState.QUIET


def test_an_application_is_quiet_once_its_poller_has_looked_again(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    send(detector, worker, 1.0)
    poller.run()
    assert detector.look(1.003) is IdleState.WAITS
    assert detector.look(1.004) is IdleState.QUIET


@pytest.mark.parametrize("waits_at", ["futex_wait_queue", "do_epoll_wait"])
def test_who_polls_seldom_is_known_though_the_kernel_tells_late_where_it_waits(
    detector: IdleDetector, poller: FakeThread, monkeypatch: pytest.MonkeyPatch, waits_at: str
) -> None:
    """One that waited for a core was taken for one that waits at a socket."""
    detector.count(0.0)
    poller.waits_at = "0"
    poller.run(12)

    def tell(_: float) -> None:
        poller.waits_at = waits_at
        poller.be("S")

    monkeypatch.setattr(thread_watch.time, "sleep", tell)
    detector.find_pollers(0.25)
    assert (POLLER in detector.pollers) is (waits_at != "do_epoll_wait")


def test_a_poller_that_waits_for_a_core_is_waited_for(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    send(detector, worker, 1.0)
    poller.be("R")
    assert detector.look(1.5) is IdleState.WAITS
    assert POLLER in detector.pollers
    poller.run()
    assert detector.look(1.501) is IdleState.WAITS
    assert detector.look(1.502) is IdleState.QUIET


def test_a_poller_that_sleeps_on_is_given_up(detector: IdleDetector, worker: FakeThread, poller: FakeThread) -> None:
    give_up(detector, worker, poller)
    assert detector.pollers == {}


def test_a_poller_that_was_given_up_is_taken_back_when_it_polls_again(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    give_up(detector, worker, poller)
    detector.begin(1.101, fresh=True, ticked=True)
    worker.run()
    verdicts: list[IdleState] = []
    for millisecond in range(102, 110):
        poller.run()
        verdicts.append(detector.look(1.0 + PERIOD_S * millisecond))
    assert detector.pollers == {POLLER: pytest.approx(PERIOD_S)}
    assert IdleState.QUIET in verdicts


def test_a_poller_that_slept_for_a_minute_is_taken_back_as_soon(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    give_up(detector, worker, poller)
    detector.begin(61.0, fresh=False, ticked=True)
    worker.run()
    for millisecond in range(1, 12):
        poller.run()
        detector.look(61.0 + PERIOD_S * millisecond)
    assert detector.pollers == {POLLER: pytest.approx(PERIOD_S)}


def test_a_thread_that_is_given_up_again_and_again_is_taken_back_later(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    now_s, needed = 1.0, list[int]()
    for _ in range(6):
        send(detector, worker, now_s)
        assert detector.look(now_s + 0.1) is IdleState.QUIET
        polls = 0
        while not detector.pollers and polls < 100:
            poller.run()
            polls += 1
            detector.look(now_s + 0.1 + PERIOD_S * polls)
        needed.append(polls)
        now_s += 1.0
    assert needed == [4, 8, 16, 32, 64, 64]


def look_until(detector: IdleDetector, begun_s: float, ends_s: float) -> None:
    """Looks each hundredth of a second."""
    for number in range(1, round(100 * (ends_s - begun_s)) + 1):
        detector.look(begun_s + 0.01 * number)


def test_what_threads_wait_for_a_core_is_no_time_of_the_application(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    for second in range(20):  # two that hand on to each other, and run for 1 ms before others have the cores
        runs, rests = (worker, poller) if second % 2 else (poller, worker)
        rests.run(ran_ns=1_000_000)
        runs.be("R")
        look_until(detector, 1.0 + second, 2.0 + second)
    assert detector.has_time(2.0, 21.0)


def test_a_thread_that_computes_has_as_much_time_as_it_runs(detector: IdleDetector, worker: FakeThread) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    worker.be("R")
    look_until(detector, 1.0, 5.0)
    worker.run(ran_ns=1_900_000_000)
    assert detector.has_time(2.0, 5.0)
    worker.run(ran_ns=200_000_000)
    assert not detector.has_time(2.0, 5.0)


def test_a_poller_that_waits_for_a_core_takes_no_time_of_the_application(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    known(detector, poller)
    send(detector, worker, 1.0)
    poller.be("R")
    look_until(detector, 1.01, 9.01)
    assert detector.has_time(2.0, 9.01)


def test_what_nodes_wait_for_answers_of_the_master_is_no_time_of_the_application(
    detector: IdleDetector, worker: FakeThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests = itertools.count(1)
    monkeypatch.setattr(Graph, "served", property(lambda _: next(requests)))
    detector.begin(1.0, fresh=False, ticked=True)
    for number in range(1, 400):  # parameters, one after the other, as planners ask for them
        worker.run()
        assert detector.look(1.0 + 0.01 * number) is IdleState.SOON
    assert detector.has_time(2.0, 5.0)


def test_sleep_is_time_of_the_application_as_far_as_it_was_seen(detector: IdleDetector, worker: FakeThread) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    worker.run()
    worker.nap()
    assert detector.look(3.5) is IdleState.SOON  # who looks that late had no core, as perhaps the worker
    assert detector.has_time(2.0, 3.5)
    look_until(detector, 3.5, 5.5)
    assert not detector.has_time(2.0, 5.5)


def test_what_whoever_looks_waits_for_a_core_is_no_sleep_of_the_application(
    looker: FakeThread, detector: IdleDetector, worker: FakeThread
) -> None:
    """Naps are held for as long: of thousands in a message, each is ended by a look."""
    detector.begin(1.0, fresh=False, ticked=True)
    worker.run()
    worker.nap()
    for number in range(1, 400):
        looker.run(waited_ns=9_000_000)
        detector.look(1.0 + 0.01 * number)
    assert detector.has_time(2.0, 5.0)


def test_who_does_not_rest_is_named_with_where_it_waits_and_how_often_it_woke(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread
) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    poller.run(2600)
    poller.nap()
    worker.run(1)
    worker.be("R")
    detector.look(2.0)
    process = f"process {os.getpid()}"
    first = f"{process}, thread {WORKER}: runs, ran 0.5 times a second"
    assert (
        detector.restless(3.0)
        == f"{first}; {process}, thread {POLLER}: waits in hrtimer_nanosleep, ran 1300 times a second"
    )


def test_one_that_sleeps_on_by_the_walls_clock_is_told_from_one_that_wakes_or_waits(
    detector: IdleDetector, worker: FakeThread
) -> None:
    detector.count(0.0)
    assert not detector.sleeps_on()
    worker.nap()
    assert detector.sleeps_on()
    worker.run()
    assert not detector.sleeps_on()


def test_what_was_before_something_was_sent_does_not_count(detector: IdleDetector, worker: FakeThread) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    worker.run(ran_ns=9_000_000_000)
    worker.be("R")
    look_until(detector, 1.0, 2.0)
    worker.ran_ns += 1_000_000_000
    worker.be("R")
    detector.begin(2.1, fresh=True, ticked=True)
    look_until(detector, 2.1, 5.0)
    assert detector.has_time(2.0, 5.0)


def test_a_limit_ends_after_thirty_times_as_long_for_one_that_neither_runs_nor_sleeps(
    detector: IdleDetector, worker: FakeThread
) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    worker.be("D")
    assert detector.look(1.1) is IdleState.AWAKE
    assert detector.has_time(2.0, 60.9)
    assert not detector.has_time(2.0, 61.1)


def test_a_nap_that_the_kernel_does_not_tell_at_once_is_waited_for(detector: IdleDetector, worker: FakeThread) -> None:
    detector.begin(1.0, fresh=False, ticked=True)
    worker.waits_at = "0"
    worker.run()
    detector.look(1.03)
    assert detector.look(1.031) is IdleState.WAITS
    worker.waits_at = "futex_wait_queue"
    worker.be("S")
    assert detector.look(1.032) is IdleState.QUIET


def test_an_application_is_quiet_once_its_nodes_are_connected(
    detector: IdleDetector, worker: FakeThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that registered may sleep until it connects; one that never does has the time of a callback that naps."""
    answers = iter([False, False, True])
    monkeypatch.setattr(detector.graph, "linked", lambda: next(answers))
    send(detector, worker, 1.0)
    assert [detector.look(1.01 * n) for n in (1, 2)] == [IdleState.WAITS, IdleState.QUIET]
    monkeypatch.setattr(detector.graph, "linked", lambda: False)
    send(detector, worker, 10.0)
    looks = [detector.look(10.0 + 0.02 * number) for number in range(1, 61)]
    assert looks.index(IdleState.QUIET) == pytest.approx(1.0 / 0.02, abs=3)


def test_who_computed_for_long_has_as_long_to_connect(
    detector: IdleDetector, worker: FakeThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a node computes for before it subscribes takes longer on a slow machine, and decides nothing."""
    answers = iter([False, True])
    monkeypatch.setattr(detector.graph, "linked", lambda: next(answers))
    detector.begin(1.0, fresh=False, ticked=True)
    worker.run(ran_ns=1_500_000_000)
    looks = [detector.look(2.6 + 0.001 * number) for number in range(3)]
    assert looks == [IdleState.SOON, IdleState.WAITS, IdleState.QUIET]


def let_go(detector: IdleDetector, gate: FakeGate, poller: FakeThread, now_s: float) -> list[IdleState]:
    """Looks until the application is quiet; whenever the poller is let go, it polls in vain, and naps again."""
    verdicts: list[IdleState] = []
    while not verdicts or verdicts[-1] is not IdleState.QUIET:
        verdicts.append(detector.look(now_s + 0.0001 * len(verdicts)))
        if not gate.held:
            poller.run()
            gate.hold_nap(POLLER)
    return verdicts


def test_a_thread_whose_nap_is_held_looks_once_more_when_it_is_let_go(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread, gate: FakeGate
) -> None:
    known(detector, poller)
    poller.waits_at = "seccomp_do_user_notification"
    gate.hold_nap(POLLER)
    for number in (1, 2):
        detector.begin(float(number), fresh=False, ticked=True)
        worker.run()
        verdicts = let_go(detector, gate, poller, number + 0.001)
        assert verdicts == [IdleState.SOON] * 3 + [IdleState.WAITS] * (len(verdicts) - 4) + [IdleState.QUIET]
        assert gate.ended == [POLLER] * number
    assert detector.pollers == {}


def test_who_rests_at_the_gate_looks_at_nothing_where_nobody_was_run(
    detector: IdleDetector, poller: FakeThread, gate: FakeGate
) -> None:
    known(detector, poller)
    gate.hold_nap(POLLER)
    detector.begin(1.0, fresh=False, ticked=True)
    let_go(detector, gate, poller, 1.03)  # the first look hears of requests
    before = list(gate.ended)
    detector.begin(2.0, fresh=False, ticked=True)
    verdicts = let_go(detector, gate, poller, 2.03)
    assert verdicts == [IdleState.QUIET]
    assert gate.ended == before


def test_a_thread_whose_time_it_was_lets_nobody_look_whose_nap_is_held(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread, gate: FakeGate
) -> None:
    """It wakes each tenth of a second, also in a message that is another process's."""
    gate.hold_nap(WORKER)
    ended: list[int] = []
    for number in range(100):
        if number % 50 == 0:
            ended.append(len(gate.ended))
            detector.begin(1.0 + 0.01 * number, fresh=False, ticked=True)
        if number % 10 == 5:
            poller.run()
        detector.look(1.0 + 0.01 * number)
        if not gate.held:
            worker.run()
            gate.hold_nap(WORKER)
    assert ended == [0, len(gate.ended)]
    assert gate.ended


@pytest.mark.parametrize(("ticked", "ended"), [(True, []), (False, [WORKER])])
def test_timers_have_their_turn_at_a_new_time_before_naps_end(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread, gate: FakeGate, ended: list[int], *, ticked: bool
) -> None:
    known(detector, poller)
    detector.timers.add(POLLER)
    gate.hold_nap(WORKER)
    detector.begin(1.0, fresh=False, ticked=ticked)
    worker.run()
    for millisecond in range(1, 10):
        detector.look(1.0 + 0.001 * millisecond)
    assert gate.ended == ended
    poller.run()
    for millisecond in range(10, 14):
        detector.look(1.0 + 0.001 * millisecond)
    assert gate.ended == [WORKER]


def test_who_waits_awake_for_a_thread_that_has_not_begun_is_helped_when_callbacks_have_no_more_time(
    detector: IdleDetector, worker: FakeThread, gate: FakeGate
) -> None:
    gate.held[POLLER] = HeldNap((0, POLLER), -1, 0, birth=True)
    detector.begin(1.0, fresh=False, ticked=True)
    for ran_s, ended in ((0.5, []), (1.1, [POLLER])):
        worker.ran_ns = round(ran_s * 1e9)
        worker.be("R")
        assert detector.look(1.0 + ran_s) is IdleState.AWAKE
        assert gate.ended == ended


def test_a_callback_that_naps_by_the_millisecond_is_waited_for(
    detector: IdleDetector, worker: FakeThread, poller: FakeThread, gate: FakeGate
) -> None:
    """Nobody has seen it poll: what it does after the nap belongs to the message."""
    detector.begin(1.0, fresh=False, ticked=True)
    worker.run()
    gate.hold_nap(WORKER)
    ended, verdict = 0, None
    for look in range(100):
        verdict = detector.look(1.03 + 0.0001 * look)
        if len(gate.ended) > ended:
            ended += 1
            worker.run()
            if ended < 3:
                gate.hold_nap(WORKER)
        elif verdict is IdleState.QUIET:
            break
    assert (verdict, gate.ended) == (IdleState.QUIET, [WORKER] * 3)
