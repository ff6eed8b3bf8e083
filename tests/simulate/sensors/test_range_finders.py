"""Range finders tell how near the nearest thing in their cones is, and nothing of the floor."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from tasks.simulate.application.contract import Body, FreeJoints
from tasks.simulate.geometry.depth_picture import DepthScene, pad_scenes
from tasks.simulate.sensors.range_finders import CLIFF_SENSORS, RANGE_FINDERS, CliffSensors, RangeFinders
from tasks.simulate.sensors.sensor import Situation, seed_words

# Ahead, to the left, behind, to the right; so low that the floor is within their cones.
AROUND = RangeFinders(finders=4, range_m=3.0, z_m=0.1, cone_rad=0.6, apart_rad=np.pi / 2, out_m=0.2)
# A wall 2 m ahead, a low step 1 m to the left, a post behind at the edge of the cone and one out of it to the right.
SOLIDS = (
    (2.05, 0.0, 0.0, 2.0, 0.05, 5.0, 1.0, 0.0),
    (0.0, 1.5, 0.0, 0.12, 0.5, 0.5, 1.0, 0.0),
    (-1.2, -0.25, 0.0, 1.0, 0.05, 0.05, 1.0, 0.0),
    (0.7, -1.2, 0.0, 1.0, 0.05, 0.05, 1.0, 0.0),
)


def scene_of(*solids: tuple[float, ...]) -> DepthScene:
    kinds = (np.array(given, np.float32).reshape(-1, n) for given, n in ((solids, 8), ((), 5), ((), 29)))
    return pad_scenes([DepthScene(*kinds, ceiling_m=np.array([2.5], np.float32))])[0]


def told(finders: RangeFinders, step: int = 0) -> Float[np.ndarray, "finders"]:
    scene = scene_of(*SOLIDS)
    none: Any = None

    def told_in(scene: DepthScene) -> jax.Array:
        now = Situation(Body(jnp.zeros(3), none, none, none), none, jnp.asarray(seed_words(1)), jnp.int32(step), scene)
        return RANGE_FINDERS.observe(finders, finders, (), now)["finder_m"]

    return np.asarray(jax.jit(told_in)(scene))


@pytest.mark.long
def test_each_tells_of_the_nearest_thing_in_its_cone_from_where_it_is_mounted():
    ahead, left, behind, right = told(AROUND)
    assert ahead == pytest.approx(1.8, abs=1e-3)
    assert left == pytest.approx(0.8, abs=1e-3)
    assert behind == pytest.approx(np.hypot(0.95, 0.225), abs=0.03)  # by the nearest of its rays
    assert right == np.float32(AROUND.range_m)


@pytest.mark.long
def test_what_sees_nothing_stays_so_and_the_others_err_as_declared():
    noisy = AROUND._replace(sigma_m=0.05)
    first, second = told(noisy, 0), told(noisy, 1)
    assert first[3] == second[3] == np.float32(AROUND.range_m)
    assert (first[:3] != second[:3]).all()
    np.testing.assert_allclose(first[:3], told(AROUND)[:3], atol=0.25)
    np.testing.assert_array_equal(told(AROUND._replace(dropout=1.0)), np.full(4, AROUND.range_m, np.float32))


@pytest.mark.long
def test_a_robot_whose_front_is_over_an_edge_is_told_of_the_cliff():
    # It stands on a platform of 0.2 m that ends 0.1 m ahead of its axis, and a board lies on that to its right.
    scene = scene_of((-0.9, 0.0, 0.0, 0.2, 1.0, 1.0, 1.0, 0.0), (0.0, -0.3, 0.2, 0.22, 0.2, 0.2, 1.0, 0.0))
    three = CliffSensors(sensors=3, range_m=0.5, first_rad=-np.pi / 2, apart_rad=np.pi / 2)
    none: Any = None

    def body(z: float) -> Body:
        # An axis of its own is 0.1 m above what it stands on; turned by nothing.
        joints = FreeJoints(jnp.array([0, 0, 0.1 + z, 1, 0, 0, 0], jnp.float32), jnp.zeros(6))
        return Body(jnp.zeros(3), jnp.zeros(3), none, none, joints)

    def told_in(scene: DepthScene, cliffs: CliffSensors) -> jax.Array:
        now = Situation(body(0.2), none, jnp.asarray(seed_words(1)), jnp.int32(0), scene)
        start_m = CLIFF_SENSORS.begin(three, cliffs, now._replace(body=body(0.0)))
        return CLIFF_SENSORS.observe(three, cliffs, start_m, now)["cliff_m"]

    told = jax.jit(told_in)
    right, ahead, left = np.asarray(told(scene, three))
    assert (right, ahead, left) == pytest.approx((0.03, 0.25, 0.05), abs=1e-5)
    assert (told(scene, three._replace(dropout=1.0)) == 0.5).all()
