"""Whether processes on Fast DDS have told each other of all their readers and writers, by when their threads ran."""

from pathlib import Path

import pytest

from tasks.ros.ros2 import discovery_watch
from tasks.ros.ros2.discovery_watch import DiscoveryWatch

_COUNT = 2


class Machine:
    """Two processes, each with a thread of Fast DDS's for what is due, and a clock."""

    def __init__(self, proc: Path) -> None:
        self.proc, self.now_s = proc, 100.0
        self.runs, self.waited_s = {1: 0, 2: 0}, 0.0
        self.watch = DiscoveryWatch(lambda: self.waited_s, proc)
        for pid in self.runs:
            self.name(pid, "dds.ev.0")
            self.run(pid)

    def name(self, pid: int, name: str) -> None:
        """Gives a process's thread a name."""
        folder = self.proc / str(pid) / "task" / str(pid)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "comm").write_text(f"{name}\n")

    def run(self, pid: int) -> None:
        """Runs it once more."""
        self.runs[pid] += 1
        (self.proc / str(pid) / "task" / str(pid) / "schedstat").write_text(f"{self.runs[pid]} 0 {self.runs[pid]}\n")
        self.be(pid, "S")

    def be(self, pid: int, state: str) -> None:
        """Puts it into a state, such as ``R`` for one that waits for a core."""
        (self.proc / str(pid) / "task" / str(pid) / "stat").write_text(f"{pid} (dds.ev.0) {state} 1 1")

    def perf_counter(self) -> float:
        """Returns its time."""
        return self.now_s

    def told_after(self, wakes: dict[float, list[int]], news_s: float = 100.0, until_s: float = 12.0) -> float | None:
        """Returns after how many seconds all is told, where these wake up after so many; None for never."""
        due = dict(sorted(wakes.items()))
        while self.now_s - news_s < until_s:
            for at_s in [each for each in due if each <= self.now_s - news_s]:
                for pid in due.pop(at_s):
                    self.run(pid)
            if self.watch.told([1, 2], _COUNT, news_s):
                return round(self.now_s - news_s, 1)
            self.now_s += 0.05
        return None


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine(tmp_path)
    monkeypatch.setattr(discovery_watch, "time", made)
    return made


def test_all_is_told_once_all_threads_slept_for_longer_than_fast_dds_waits_before_it_asks_again(
    machine: Machine,
) -> None:
    assert machine.told_after({}) == pytest.approx(1.3, abs=0.3)


def test_who_asks_again_each_second_has_something_left_to_tell(machine: Machine) -> None:
    asks: dict[float, list[int]] = {each: [1] for each in (1.0, 2.0, 3.0)}
    assert machine.told_after(asks) == pytest.approx(4.3, abs=0.3)


def test_who_wakes_up_after_a_long_sleep_makes_nobody_wait_again(machine: Machine) -> None:
    assert machine.told_after({0.9: [2], 1.5: [1], 2.1: [1]}) == pytest.approx(2.2, abs=0.3)


def test_threads_that_slept_one_after_the_other_have_not_slept_at_one_moment(machine: Machine) -> None:
    asks: dict[float, list[int]] = {0.5: [2], 1.0: [2], 1.4: [1, 2], 2.0: [1], 2.6: [1]}
    assert machine.told_after(asks) == pytest.approx(3.9, abs=0.3)


def test_a_thread_that_waits_for_a_core_does_not_sleep(machine: Machine) -> None:
    machine.be(1, "R")
    assert machine.told_after({3.0: [1]}) == pytest.approx(4.3, abs=0.3)


def test_who_comes_later_makes_all_wait_once_more(machine: Machine) -> None:
    machine.told_after({})
    came_s = machine.now_s
    assert machine.told_after({0.2: [1, 2]}, came_s) == pytest.approx(1.5, abs=0.3)


def test_where_a_thread_has_no_name_five_seconds_without_news_are_enough(machine: Machine) -> None:
    machine.name(1, "python3")
    assert machine.told_after({}) == pytest.approx(5.0, abs=0.3)
    assert not machine.watch.guessed


def test_where_a_thread_never_sleeps_for_long_twenty_seconds_without_news_are_enough(machine: Machine) -> None:
    restless: dict[float, list[int]] = {each / 4: [1] for each in range(1, 100)}
    assert machine.told_after(restless, until_s=25.0) == pytest.approx(20.0, abs=0.3)
    assert machine.watch.guessed


def test_where_others_have_the_cores_threads_have_longer_to_come_to_rest(machine: Machine) -> None:
    restless: dict[float, list[int]] = {each / 4: [1] for each in range(1, 200)}
    assert machine.told_after(restless, until_s=1.0) is None
    machine.waited_s = 10.0
    assert machine.told_after(restless, until_s=50.0) == pytest.approx(30.0, abs=0.3)
    assert machine.watch.guessed
