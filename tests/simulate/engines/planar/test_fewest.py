"""A physics step looks at no more obstacles than a lane may touch, and has the same bits as among all."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.engines.planar.fewest import among_fewest, few_counts, need
from tasks.simulate.engines.planar.planar_algebra import Planar
from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tasks.simulate.engines.planar.planar_robot import planar_robot
from tests.factories.planar import CAPSULE, DRUM, ROUGH, Parts, box, write_robot

LANES, STEPS = 16, 40
ARM = '<geom type="sphere" size="0.06" pos="0.3 0.1 0" mass="0.1"/>'


def nearest_free(free_m: list[float], moved_m: float, acceleration: float = 1.0) -> int:
    moved = Planar(jnp.float32(moved_m), jnp.float32(0.0), jnp.float32(0.0))
    before = Planar(jnp.float32(1.0), jnp.float32(acceleration), jnp.float32(1.0))
    return int(need([jnp.float32(each) for each in free_m], moved, before))


def test_the_lane_that_needs_most_decides_for_all():
    among = among_fewest(lambda count, given: given + count, (0, 2, 6))
    mapped = jax.vmap(among)

    assert mapped(jnp.array([0, 0]), jnp.zeros(2)).tolist() == [0, 0]
    assert mapped(jnp.array([0, 1]), jnp.zeros(2)).tolist() == [2, 2]
    assert mapped(jnp.array([3, 1]), jnp.zeros(2)).tolist() == [6, 6]
    assert among(jnp.int32(1), jnp.float32(0.0)) == 2


@pytest.mark.parametrize(("isa", "counts"), [("AVX", (0, 1, 3, 6)), ("AVX2", (6,))])
def test_where_products_and_sums_may_be_fused_work_is_done_among_all(
    monkeypatch: pytest.MonkeyPatch, isa: str, counts: tuple[int, ...]
):
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    monkeypatch.setenv("XLA_FLAGS", f"--xla_cpu_max_isa={isa}")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert few_counts(6) == counts


def test_obstacles_beyond_the_last_that_can_be_touched_are_not_needed():
    assert nearest_free([0.3, 0.4], 0.1) == 0
    assert nearest_free([0.0, 0.4, 0.4], 0.1) == 1
    # The window's order is that of rounded distances.
    assert nearest_free([0.4, 0.05, 0.4], 0.1) == 2


@pytest.mark.parametrize(("moved_m", "acceleration"), [(np.nan, 1.0), (0.1, -0.0)])
def test_all_obstacles_are_needed_where_one_more_could_change_a_bit(moved_m: float, acceleration: float):
    assert nearest_free([0.4, 0.4], moved_m, acceleration) == 2


@pytest.mark.parametrize(
    "parts", [{}, ROUGH, DRUM, CAPSULE, {"more": ARM}], ids=["ball", "rough", "drum", "capsule", "arm"]
)
def test_a_step_among_few_has_the_bits_of_a_step_among_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: Parts
):
    path = write_robot(tmp_path, parts)
    few = bumping(path)
    monkeypatch.setattr("tasks.simulate.engines.planar.fewest.FEW", ())
    among_all = bumping(path)

    for one, other in zip(jax.tree.leaves(few), jax.tree.leaves(among_all), strict=True):
        assert one.tobytes() == other.tobytes()
    touching = np.asarray(few.work.impulse_ns) > 0.0
    assert 0.0 < touching.mean() < 0.9


def bumping(path: Path) -> Motion:
    """Returns what becomes of robots among obstacles, some of which stand still: (steps, lanes, ...), traced anew."""
    robot, rng = planar_robot(path), np.random.default_rng(3)
    boxes = [[box(x, y, 0.1, 0.2, yaw=yaw) for x, y, yaw in each] for each in rng.uniform(-2, 2, (LANES, 9, 3))]
    posts = [[[x, y, 0.5, 0.1, 0.5] for x, y in each] for each in rng.uniform(-2, 2, (LANES, 3, 2))]
    starts = rng.uniform(-2, 2, (LANES, 3))
    controls = np.repeat(rng.uniform(-1, 1, (STEPS // 10, LANES, 3)), 10, axis=0)
    controls[:, ::4] = 0.0
    step = jax.vmap(functools.partial(drive_among, robot))

    def advance(body: Body, control: jax.Array) -> tuple[Body, Motion]:
        motion = step(jnp.asarray(boxes), jnp.asarray(posts), body, control)
        return motion.body, motion

    begin = jax.vmap(functools.partial(first_body, robot))(jnp.asarray(starts, jnp.float32))
    drive = jax.jit(lambda begin, controls: jax.lax.scan(advance, begin, controls)[1])
    return jax.device_get(drive(begin, jnp.asarray(controls, jnp.float32)))
