"""How many workers there are, as a flow asks for it."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, cast

import pytest
from prefect.futures import PrefectFuture

from flows.prefect import worker_cluster
from flows.prefect import worker_cluster as spread_module
from flows.prefect.worker_cluster import Numbers, PieceOutcome, PieceSize, spread
from specs.errors import StageFailed


def test_a_scheduler_is_asked_once_a_second_however_often_the_flow_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, asked = [100.0], list[int]()

    def count() -> int:
        asked.append(1)
        return len(asked)

    monkeypatch.setattr(worker_cluster.time, "monotonic", lambda: now_s[0])
    width = worker_cluster._once_a_second(count)
    assert [width(), width(), width()] == [1, 1, 1]
    now_s[0] += 1.0
    assert [width(), width()] == [2, 2]


class Hands:
    """A crew of threads, and a store that knows which numbers are done."""

    def __init__(self, workers: int = 2, *, dies: Callable[[int], bool] = lambda _: False) -> None:
        self.done: set[int] = set()
        self.death: BaseException = ConnectionError("the worker died")
        self.begun: list[int] = []
        self.most_flying = 0
        self.wanted = True
        self.dies, self._workers = dies, workers
        self._threads = ThreadPoolExecutor(workers)
        self._flying: set[Future[float]] = set()

    def run(self, count: int) -> None:
        spread(
            range(count),
            self._hand_out,
            width=lambda: self._workers,
            going=lambda: self.wanted,
            missing=lambda numbers: tuple(number for number in numbers if number not in self.done),
            on_end=self._on_end,
        )

    def _hand_out(self, numbers: Numbers) -> PrefectFuture[Any]:
        future = self._threads.submit(self._work, numbers)
        self._flying = {each for each in self._flying if not each.done()} | {future}
        self.most_flying = max(self.most_flying, len(self._flying))
        return cast("PrefectFuture[Any]", future)

    def _work(self, numbers: Numbers) -> float:
        for number in numbers:
            if not self.wanted:
                break
            self.begun.append(number)
            if self.dies(number):
                raise self.death
            self.done.add(number)
        return 0.001

    def _on_end(self, end: PieceOutcome) -> float:
        return end.result


def test_everything_is_done_once() -> None:
    hands = Hands()
    hands.run(500)
    assert hands.done == set(range(500))
    assert sorted(hands.begun) == list(range(500))


def test_no_more_is_promised_than_workers_come_to_soon() -> None:
    hands = Hands(workers=3)
    hands.run(300)
    assert hands.most_flying <= 6


def test_what_a_dead_worker_left_is_done_by_another_and_nothing_else_again() -> None:
    deaths = {7: 1, 100: 3}

    def dies(number: int) -> bool:
        deaths[number] = deaths.get(number, 0) - 1
        return deaths[number] >= 0

    hands = Hands(dies=dies)
    hands.run(200)
    assert hands.done == set(range(200))
    assert hands.begun.count(7) == 2
    assert hands.begun.count(100) == 4
    assert all(hands.begun.count(number) == 1 for number in hands.done - {7, 100})


def test_a_worker_that_died_after_its_work_was_done_is_no_loss() -> None:
    hands = Hands()
    hands.done.add(3)
    hands.dies = lambda number: number == 3
    hands.run(10)
    assert hands.begun.count(3) == 1


def test_what_kills_every_worker_ends_the_batch_and_says_why() -> None:
    hands = Hands(dies=lambda number: number == 5)
    with pytest.raises(StageFailed, match=r"5 was lost 4 times.*the worker died"):
        hands.run(20)


def test_nothing_is_handed_out_once_nobody_wants_it() -> None:
    hands = Hands(workers=1)

    def calls_off(number: int) -> bool:
        hands.wanted = number < 4
        return False

    hands.dies = calls_off
    hands.run(1000)
    assert hands.done == set(range(5))


def test_a_crew_that_has_lost_all_its_workers_is_not_waited_for_once_nobody_wants_its_pieces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spread_module, "_PATIENCE_S", 0.0)
    looks = iter([True, False])
    never = cast("PrefectFuture[Any]", Future[float]())
    spread(
        [1],
        lambda _: never,
        width=lambda: 1,
        going=lambda: next(looks),
        missing=lambda numbers: numbers,
        on_end=lambda _: 0.0,
    )
    assert next(looks, None) is None


def test_pieces_grow_until_they_last_long_and_shrink_towards_the_end() -> None:
    pace = PieceSize()
    assert pace.size(10_000, 2) == 1
    pace.learn(1, 0.5)
    assert pace.size(10_000, 2) == 30
    assert pace.size(40, 2) == 10
    assert pace.size(1, 2) == 1
    pace.learn(1, 60.0)
    assert pace.size(10_000, 2) == 1


def test_many_workers_get_longer_pieces_so_that_no_more_of_them_end_in_a_second() -> None:
    pace = PieceSize()
    pace.learn(1, 1.0)
    ends_a_second = [width / pace.size(10**9, width) for width in (100, 1000, 10_000)]
    assert ends_a_second == [5.0, 5.0, 5.0]


def test_what_is_cancelled_with_its_scheduler_is_handed_out_again() -> None:
    hands = Hands()
    hands.dies, hands.death = lambda number: hands.begun.count(number) == 1 and number == 3, asyncio.CancelledError()
    hands.run(10)
    assert hands.done == set(range(10))
    assert hands.begun.count(3) == 2
