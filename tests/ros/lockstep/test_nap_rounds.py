"""In which order held naps end, and how often, by what threads do that a test plays."""

import itertools
from pathlib import Path

import pytest

from tasks.ros.lockstep.nap_rounds import NapRounds
from tasks.ros.process.thread_watch import ThreadWatch
from tests.ros.lockstep.conftest import FakeGate
from tests.ros.process.proc_folder import FakeThread, fake_thread

NAP_S = 0.02
ONE, TWO = 10, 20


class Process:
    """Threads of one process at the gate.

    Args:
        gate: Where they nap.
        proc: Where the kernel tells of them.
        pid: Its number, from which on its threads have theirs.
        threads: How many there are.
    """

    def __init__(self, gate: FakeGate, proc: Path, pid: int, threads: int) -> None:
        self.tids = list(range(pid, pid + threads))
        self.threads: dict[int, FakeThread] = {tid: fake_thread(proc, pid, tid) for tid in self.tids}
        for tid in self.tids:
            gate.hold_nap(tid)


@pytest.fixture
def watch(proc: Path) -> ThreadWatch:
    return ThreadWatch(proc)


@pytest.fixture
def rounds(gate: FakeGate, watch: ThreadWatch) -> NapRounds:
    return NapRounds(gate, watch, NAP_S)


def made(gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds, *sizes: int) -> list[Process]:
    """Returns processes of so many threads each, all of which are known to poll."""
    found = [Process(gate, proc, pid, size) for pid, size in zip((ONE, TWO), sizes, strict=False)]
    watch.refresh([each.tids[0] for each in found])
    rounds.polling.update(tid for each in found for tid in each.tids)
    return found


def end_all(rounds: NapRounds, gate: FakeGate, *, most: int = 10_000) -> list[int]:
    """Lets all poll whose turn it is, in vain, and returns who did."""
    before = len(gate.ended)
    while len(gate.ended) < before + most and rounds.end_next(patient=True):
        gate.hold_nap(gate.ended[-1])
    return gate.ended[before:]


@pytest.mark.parametrize("threads", [1, 2, 3, 4])
def test_the_threads_of_a_process_poll_in_every_order(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds, threads: int
) -> None:
    (process,) = made(gate, proc, watch, rounds, threads)
    rounds.touch({ONE})
    ended = end_all(rounds, gate)
    assert ended == process.tids * threads
    for order in itertools.permutations(process.tids):
        rest = iter(ended)
        assert all(tid in rest for tid in order)
    assert end_all(rounds, gate) == []


def test_processes_poll_one_after_the_other_and_only_where_somebody_was_run(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds
) -> None:
    one, two = made(gate, proc, watch, rounds, 1, 2)
    rounds.touch({TWO})
    assert end_all(rounds, gate) == two.tids * 2
    rounds.touch({0})
    assert end_all(rounds, gate) == one.tids + two.tids * 2
    rounds.begin()
    assert end_all(rounds, gate) == []


def test_all_of_a_process_poll_anew_when_another_thread_was_run_there(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds
) -> None:
    one, two = made(gate, proc, watch, rounds, 2, 1)
    rounds.touch({ONE, TWO})
    assert end_all(rounds, gate, most=3) == [*one.tids, one.tids[0]]
    rounds.note_runs({rounds.last})
    assert end_all(rounds, gate) == [one.tids[1], *two.tids]
    rounds.note_runs({one.tids[1]})
    assert end_all(rounds, gate) == one.tids * 2


def test_all_of_a_process_poll_anew_when_one_found_something(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds
) -> None:
    """It ran for longer than a poll does that finds nothing; the second time, that is usual."""
    (process,) = made(gate, proc, watch, rounds, 2)
    rounds.touch({ONE})
    ended: list[int] = []
    for _ in range(2):
        assert rounds.end_next(patient=True)
        process.threads[process.tids[0]].run(ran_ns=150_000)
        gate.hold_nap(process.tids[0])
        ended = end_all(rounds, gate)
        rounds.touch({ONE})
    first, second = process.tids
    assert gate.ended == [first, *(first, second) * 2, first, second, first, second]
    assert ended == [second, first, second]


@pytest.mark.parametrize(("waits", "held"), [(20, True), (21, False)])
def test_who_again_and_again_waits_for_something_else_naps_as_it_likes(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds, waits: int, *, held: bool
) -> None:
    (process,) = made(gate, proc, watch, rounds, 1)
    (tid,) = process.tids
    for _ in range(waits):
        rounds.touch({ONE})
        assert rounds.end_next(patient=True)
        assert not rounds.end_next(patient=True)
        gate.hold_nap(tid)
    assert (tid not in gate.free) is held


def test_naps_of_one_that_was_never_seen_to_poll_end_for_as_long_as_a_callback_may_nap(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds
) -> None:
    (process,) = made(gate, proc, watch, rounds, 2)
    rounds.polling.clear()
    rounds.touch({ONE})
    assert end_all(rounds, gate) == process.tids * (round(NAP_S * 1000) + 1)
    assert rounds.polling == set(process.tids)


def test_callbacks_that_have_no_more_time_poll(
    gate: FakeGate, proc: Path, watch: ThreadWatch, rounds: NapRounds
) -> None:
    (process,) = made(gate, proc, watch, rounds, 1)
    rounds.polling.clear()
    rounds.touch({ONE})
    assert rounds.end_next(patient=False)
    assert rounds.polling == set(process.tids)
