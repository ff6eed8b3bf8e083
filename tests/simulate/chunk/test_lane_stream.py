"""The order in which episodes wait for lanes."""

from typing import Any, cast

from tasks.simulate.chunk.lane_stream import longest_first
from tasks.simulate.lane.staging import Lane
from tests.factories.simulations import pushing


def test_episodes_that_may_last_longest_begin_first() -> None:
    ways = [(60.0, 4.0), (60.0, 9.0), (2.0, 9.0), (60.0, None), (60.0, 4.0)]
    assert longest_first([_lane(*way) for way in ways]) == [3, 1, 0, 4, 2]


def _lane(duration_s: float, shortest_m: float | None) -> Lane:
    none = cast("Any", None)
    return Lane(pushing(0, world="hand/pen-0", duration_s=duration_s), none, none, shortest_m)
