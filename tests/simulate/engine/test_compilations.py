"""One program for all worlds: what a batch adds besides applications compiles nothing more."""

import logging

import jax
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, cluttered, delivery, pen, simulate_lanes

COMPILED = "Finished XLA compilation"
LANES = 16
FIRST = {"hand/first": cluttered(0)}


def run(requests: list[EpisodeRequest], worlds: dict[str, World], engine: str) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, LANES)
    return simulate_lanes(chunk, worlds, FOLDERS, lanes=LANES, engine=engine, should_stop=lambda: False)


@pytest.fixture(params=["planar", "mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def engine(request: pytest.FixtureRequest) -> str:
    """An engine that has simulated a chunk in one world."""
    run([delivery(k, world="hand/first", seed=k, duration_s=1.0) for k in range(LANES)], FIRST, request.param)
    return request.param


def test_worlds_seeds_numbers_and_durations_compile_nothing(engine: str, caplog: pytest.LogCaptureFixture):
    worlds = {"hand/pen": pen(6.0, 1), "hand/bare": pen(5.0, 2).model_copy(update={"furniture": ()})}
    worlds |= {f"hand/apartment-{seed}": cluttered(seed) for seed in range(1, 5)}
    assert len({len(obstacles(world, 0.02, 0.38).boxes) for world in worlds.values()}) >= 3
    others = [
        delivery(k, world=name, seed=100 + k, speed=f"0.{3 + k}", duration_s=1.0 + 0.5 * k)
        for k, name in enumerate(worlds)
    ]
    with jax.log_compiles(), caplog.at_level(logging.WARNING, logger="jax"):
        rows = run(others, worlds, engine)
        compiled = [record.message for record in caplog.records if COMPILED in record.message]
        jax.jit(lambda x: 5 * x)(1.0)
    assert {(row.status, row.engine) for row in rows} == {("Completed", engine)}
    assert compiled == []
    assert any(COMPILED in record.message for record in caplog.records)  # JAX still says so in these words
