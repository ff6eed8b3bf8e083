"""How lanes are laid out on devices."""

import jax
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.episode import EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk.chunk_simulation import ready_chunk
from tasks.simulate.engines.program import padded_lanes
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, delivery, pen, pushing, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES, Simulate


@given(st.integers(1, 5000), st.integers(1, 64))
def test_every_device_gets_the_same_whole_vectors_of_lanes(lanes: int, devices: int):
    padded = padded_lanes(lanes, devices)
    assert lanes <= padded < lanes + 8 * devices
    assert padded % (8 * devices) == 0


@pytest.mark.long
@pytest.mark.parametrize("engine", ["mujoco", "planar", pytest.param("mjx", marks=pytest.mark.soak)])
def test_the_second_slice_compiles_nothing(pens: dict[str, World], engine: str):
    requests = [delivery(k, world="hand/pen-0", duration_s=60.0) for k in range(2)]
    run = ready_chunk(requests, pens, FOLDERS, lanes=PUSHER_LANES, engine=engine).run
    assert run is not None
    kinds: list[list[tuple[tuple[int, ...], str, bool]]] = []
    state = run.begin()
    for _ in range(2):
        kinds.append([(leaf.shape, leaf.dtype.name, leaf.weak_type) for leaf in jax.tree.leaves(state)])
        state, _ = run.advance(state)
    assert kinds[0] == kinds[1]


@pytest.mark.long
def test_the_lane_count_changes_no_result(push: Simulate):
    world = {"hand/pen-0": pen(4.5, 0)}
    requests = [pushing(k, world="hand/pen-0", seed=k) for k in range(5)]
    in_small_chunks: list[EpisodeResult] = [
        row
        for chunk in plan_chunks(requests, 3)
        for row in simulate_lanes(chunk, world, FOLDERS, lanes=3, should_stop=lambda: False)
    ]
    assert PUSHER_LANES != 3
    assert in_small_chunks == push(requests, worlds=world)
