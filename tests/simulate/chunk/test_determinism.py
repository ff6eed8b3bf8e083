"""An episode's row depends on its request alone."""

import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, delivery, pen, pushing, simulate_lanes
from tests.simulate.conftest import LANES, Simulate

REQUESTS = [
    delivery(k, world=f"hand/apartment-{k % 4}", seed=k // 4, speed=("0.4", "0.7")[k % 2], duration_s=40.0)
    for k in range(LANES)
]

PUSHES = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=6.0) for k in range(256)]


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


@pytest.fixture(scope="module", params=["planar", "mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def large(request: pytest.FixtureRequest, pens: dict[str, World]) -> tuple[str, list[EpisodeResult]]:
    """A batch of 256 robots that push on blindly, on each engine."""
    (chunk,) = plan_chunks(PUSHES, len(PUSHES))
    return request.param, simulate_lanes(
        chunk, pens, FOLDERS, lanes=len(PUSHES), engine=request.param, should_stop=lambda: False
    )


@pytest.mark.long
def test_a_batch_of_one_is_the_lane_in_a_batch_of_256(large: tuple[str, list[EpisodeResult]], pens: dict[str, World]):
    engine, rows = large
    assert sum(row.collisions > 0 for row in rows[::17]) >= 8
    for position in range(0, len(PUSHES), 17):
        (chunk,) = plan_chunks([PUSHES[position]], 1)
        alone = simulate_lanes(chunk, pens, FOLDERS, lanes=1, engine=engine, should_stop=lambda: False)
        assert alone == [rows[position]]


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mujoco"])
def test_where_in_a_large_batch_a_lane_lies_does_not_matter(engine: str):
    requests = [delivery(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=5.0) for k in range(128)]
    worlds = {f"hand/pen-{k}": pen(6.0, k) for k in range(3)}
    order = np.random.default_rng(0).permutation(len(requests)).tolist()

    def run(requests: list[EpisodeRequest]) -> list[EpisodeResult]:
        (chunk,) = plan_chunks(requests, 128)
        return simulate_lanes(chunk, worlds, FOLDERS, lanes=128, engine=engine, should_stop=lambda: False)

    in_order = run(requests)
    assert run([requests[k] for k in order]) == [in_order[k] for k in order]


@pytest.mark.long
def test_a_larger_world_in_the_chunk_changes_no_bit_of_a_lane():
    small, large = delivery(0, world="hand/small", seed=3, duration_s=8.0), delivery(1, world="hand/large", seed=3)
    worlds = {"hand/small": pen(6.0, 1), "hand/large": pen(30.0, 2)}

    def run(*requests: EpisodeRequest) -> EpisodeResult:
        (chunk,) = plan_chunks(requests, 8)
        return simulate_lanes(chunk, worlds, FOLDERS, lanes=8, should_stop=lambda: False)[0]

    present = {name: worlds[name] for name in ("hand/small",)}
    (alone,) = plan_chunks([small], 8)
    assert simulate_lanes(alone, present, FOLDERS, lanes=8, should_stop=lambda: False) == [run(small, large)]
