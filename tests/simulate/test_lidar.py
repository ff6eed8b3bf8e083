"""The lidar measures what MuJoCo's own rays measure."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.simulate.lidar import scan_ranges
from tasks.simulate.obstacles import obstacles, padded
from tasks.simulate.reference import reference_model, reference_ranges
from tasks.simulate.sensors import Lidar
from tests.simulate_factory import COURIER, FAULTY, FOLDERS, pen

WORLD = pen(6.0, 1)
SEEN = padded([obstacles(WORLD, 0.199, 0.201)])[0]
SCAN = jax.jit(lambda pose: scan_ranges(jnp.asarray(SEEN.boxes), jnp.asarray(SEEN.cylinders), pose, 32, 10.0))


LIDAR = Lidar(rays=32, range_m=10.0, height_m=0.2)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return reference_model(FOLDERS[COURIER] / "robot.xml", WORLD)


def test_ranges_agree_with_mujocos_within_a_millimetre(model: mujoco.MjModel):
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-1.2, 1.2, (100, 2)), rng.uniform(-np.pi, np.pi, 100)])
    ours = np.stack([np.asarray(SCAN(jnp.asarray(pose, jnp.float32))) for pose in poses])
    theirs = np.stack([reference_ranges(model, LIDAR, pose) for pose in poses])
    # A ray that passes an edge by a hair's breadth may hit it in one precision and miss it in the other.
    assert np.quantile(np.abs(ours - theirs), 0.999) < 1e-3
    assert (theirs < 6.0).all()  # walls all around: every ray hits


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.integers(0, 31))
def test_turning_by_a_ray_shifts_the_ranges_by_one(x: float, y: float, ray: int):
    step = 2 * np.pi / 32
    ahead = np.asarray(SCAN(jnp.array([x, y, 0.0])))
    turned = np.asarray(SCAN(jnp.array([x, y, ray * step])))
    assert np.mean(np.abs(np.roll(ahead, -ray) - turned) > 1e-3) <= 2 / 32


def test_nothing_near_gives_the_range():
    nothing = padded([obstacles(WORLD, 5.0, 6.0)])[0]
    ranges = scan_ranges(jnp.asarray(nothing.boxes), jnp.asarray(nothing.cylinders), jnp.zeros(3), 16, 7.5)
    np.testing.assert_array_equal(ranges, np.full(16, 7.5, np.float32))


def test_the_reference_sees_no_part_of_the_robot(model: mujoco.MjModel):
    alone = reference_model(FOLDERS[FAULTY] / "robot.xml", WORLD.model_copy(update={"walls": (), "furniture": ()}))
    assert (reference_ranges(alone, LIDAR, np.zeros(3)) == 10.0).all()
