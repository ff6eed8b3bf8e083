"""The compiled physics step computes what is dear once, not in each operation that reads it."""

from pathlib import Path

import jax
import jax.numpy as jnp

from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tasks.simulate.engines.planar.planar_robot import planar_robot
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tests.factories.planar import write_robot

LANES = 16


def test_where_a_robot_heads_is_computed_once_a_physics_step(tmp_path: Path):
    robot = planar_robot(write_robot(tmp_path, {}))

    def driven(x: jax.Array) -> jax.Array:
        around = LaneObstacles(jnp.ones((7, 8)), jnp.ones((1, 5)), jnp.ones((0, 20)))
        body = first_body(robot, jnp.stack([x, x, x]))
        return drive_among(robot, around, body, jnp.ones(3)).body.qpos

    compiled = jax.jit(jax.vmap(driven)).lower(jnp.zeros(LANES)).compile().as_text() or ""
    # Before the first step, and after each.
    assert compiled.count(" cosine(") == compiled.count(" sine(") == 2
