"""The order in which episodes wait for lanes, and which need not wait."""

from types import SimpleNamespace
from typing import Any, cast

from tasks.simulate.chunk.lane_pool import EpisodeGroup, LanePool, PendingChunk, longest_first
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import Chunk
from tests.factories.simulations import pushing


def test_episodes_that_may_last_longest_begin_first() -> None:
    ways = [(60.0, 4.0), (60.0, 9.0), (2.0, 9.0), (60.0, None), (60.0, 4.0)]
    assert longest_first([_lane(*way) for way in ways]) == [3, 1, 0, 4, 2]


def test_a_chunk_fits_into_lanes_that_are_free_but_for_those_that_wait_before_it() -> None:
    program: Any = SimpleNamespace(lanes=4)
    wide, narrow = LanePool(program, None), LanePool(program, None)

    def coming(*parts: tuple[int, LanePool]) -> PendingChunk:
        rows = [(EpisodeGroup(program, [_lane(1.0, None)] * count), stream) for count, stream in parts]
        return PendingChunk(Chunk(number=0, requests=()), None, parts=rows)

    coming((3, wide)).wait_for_lanes()
    assert coming((1, wide), (4, narrow)).fits_into_free_lanes
    assert not coming((2, wide)).fits_into_free_lanes
    assert not coming((1, wide), (3, narrow), (2, narrow)).fits_into_free_lanes


def _lane(duration_s: float, shortest_m: float | None) -> Lane:
    none = cast("Any", None)
    return Lane(pushing(0, world="hand/pen-0", duration_s=duration_s), none, none, shortest_m)
