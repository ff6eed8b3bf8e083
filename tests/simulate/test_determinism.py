"""An episode's row depends on its request alone."""

import pytest

from specs.episode import EpisodeResult
from specs.world import World
from tests.simulate.conftest import LANES, Simulate
from tests.simulate_factory import delivery

REQUESTS = [
    delivery(k, world=f"hand/apartment-{k % 4}", seed=k // 4, speed=("0.4", "0.7")[k % 2], duration_s=40.0)
    for k in range(LANES)
]


@pytest.fixture(scope="module")
def together(deliver: Simulate) -> list[EpisodeResult]:
    return deliver(REQUESTS)


def test_a_rerun_gives_the_same_bits(deliver: Simulate, together: list[EpisodeResult]):
    assert deliver(REQUESTS) == together


@pytest.mark.parametrize("position", [0, 13, 31])
def test_a_lane_alone_is_the_lane_in_a_batch(deliver: Simulate, together: list[EpisodeResult], position: int):
    assert deliver([REQUESTS[position]]) == [together[position]]


def test_the_order_of_lanes_and_worlds_does_not_matter(
    deliver: Simulate, together: list[EpisodeResult], apartments: dict[str, World]
):
    backwards = dict(reversed(apartments.items()))
    assert deliver(REQUESTS[::-1], worlds=backwards) == together[::-1]


def test_a_sweep_over_numbers_reaches_each_lane(together: list[EpisodeResult]):
    slow = [row.path_length_m / row.simulated_s for row in together[::2]]
    fast = [row.path_length_m / row.simulated_s for row in together[1::2]]
    assert max(slow) <= 0.4 < min(fast) <= max(fast) <= 0.7
