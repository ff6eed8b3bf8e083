"""What does not fit into memory is run in smaller parts, and what comes of it stays the same."""

import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sandbox.sandbox_client import TooManyLanes, after_deaths, retry_with_fewer_lanes
from tests.factories.episodes import passed
from tests.factories.simulations import delivery

CHUNK = Chunk(number=3, requests=tuple(delivery(100 + k, world="w") for k in range(40)))


class Memory:
    """A simulator that has room for so many lanes."""

    def __init__(self, room: int, lack: Exception) -> None:
        self.room, self.lack = room, lack
        self.tried: list[int] = []

    def simulate(self, chunk: Chunk, lanes: int) -> list[EpisodeResult]:
        self.tried.append(lanes)
        assert len(chunk.requests) <= lanes
        if lanes > self.room:
            raise self.lack
        return [passed(each.index) for each in chunk.requests]


def never() -> bool:
    return False


LACKS = [
    MemoryError("no room"),
    RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 800000000000 bytes."),
]


@pytest.mark.parametrize("lack", LACKS)
def test_half_as_many_lanes_are_tried_until_they_fit(lack: Exception):
    memory = Memory(20, lack)
    rows, lanes = retry_with_fewer_lanes(CHUNK, 64, memory.simulate, never)
    assert [row.index for row in rows] == [request.index for request in CHUNK.requests]
    assert (lanes, memory.tried) == (16, [64, 32, 16, 16, 16])


def test_as_many_lanes_are_tried_as_are_known_to_fit():
    memory = Memory(24, TooManyLanes("too many applications", 24))
    rows, lanes = retry_with_fewer_lanes(CHUNK, 64, memory.simulate, never)
    assert [row.index for row in rows] == [request.index for request in CHUNK.requests]
    assert (lanes, memory.tried) == (24, [64, 24, 24])


def test_numpys_own_lack_of_memory_is_one_too():
    with pytest.raises(MemoryError) as lack:
        np.zeros((1 << 60,), np.int8)
    assert retry_with_fewer_lanes(CHUNK, 16, Memory(8, lack.value).simulate, never).lanes == 8


def test_what_does_not_fit_at_all_fails_by_our_fault():
    rows, lanes = retry_with_fewer_lanes(CHUNK, 16, Memory(7, MemoryError("no room")).simulate, never)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InternalServiceError")}
    assert rows.rows()[0].failure_reason == "out of memory even with 8 lanes: no room"
    assert (len(rows), lanes) == (40, 8)


def test_any_other_error_is_not_taken_for_a_lack_of_memory():
    with pytest.raises(RuntimeError, match="INTERNAL"):
        retry_with_fewer_lanes(CHUNK, 64, Memory(0, RuntimeError("INTERNAL: broken")).simulate, never)


def test_what_was_simulated_before_memory_ran_out_is_kept():
    memory = Memory(64, MemoryError())
    calls: list[int] = []

    def shrinking(chunk: Chunk, lanes: int) -> list[EpisodeResult]:
        calls.extend(each.index for each in chunk.requests)
        memory.room = 16 if len(memory.tried) == 1 else memory.room
        return memory.simulate(chunk, lanes)

    rows, lanes = retry_with_fewer_lanes(CHUNK, 32, shrinking, never)
    assert [row.index for row in rows] == [request.index for request in CHUNK.requests]
    assert (lanes, memory.tried) == (16, [32, 32, 16])
    assert calls == [*range(100, 132), *range(132, 140), *range(132, 140)]


def test_parts_after_a_stop_are_canceled_and_not_begun():
    memory = Memory(16, MemoryError())
    rows, _ = retry_with_fewer_lanes(CHUNK, 16, memory.simulate, lambda: True)
    assert memory.tried == [16]
    assert [row.status for row in rows] == [*["Completed"] * 16, *["Canceled"] * 24]


@pytest.mark.parametrize(
    ("lanes", "attempts", "begun_with"), [(256, 1, 256), (256, 2, 256), (256, 3, 128), (256, 9, 8), (4, 9, 4)]
)
def test_a_first_death_is_an_accident_and_further_ones_may_be_a_lack_of_memory(
    lanes: int, attempts: int, begun_with: int
):
    assert after_deaths(lanes, attempts) == begun_with
