"""Other robots on the planar engine: they stop a robot as posts do, and are told apart from solids."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tasks.simulate.lane.shared_world import Others, RobotsInputs
from tests.factories.planar import NO_BOXES, NO_CYLINDERS, Obstacles, box, on_device, padded, read, write_robot

STEPS = 40
NOTHING = Obstacles(NO_BOXES, NO_CYLINDERS)
WALL = Obstacles(np.array([box(0.6, 0.0, 0.1, 2.0)]), NO_CYLINDERS)
AHEAD_M, FAR_M = (0.7, 0.05), (40.0, 40.0)
RADIUS_M, HEIGHT_M = 0.2, 0.3


def driven(folder: Path, obstacles: Obstacles, *robots_m: tuple[float, float]) -> Motion:
    """Returns what two seconds straight ahead are, with robots that stand somewhere."""
    robot = read(write_robot(folder, {}))
    around = on_device(padded(obstacles))
    places, alike = jnp.asarray(robots_m), jnp.ones(len(robots_m))
    inputs = RobotsInputs(places, RADIUS_M * alike, 0.0 * alike, HEIGHT_M * alike, jnp.float32(RADIUS_M))
    others = (inputs, Others(places, 0.0 * places, alike > 0.0)) if robots_m else None

    def step(body: Body, control: jax.Array) -> tuple[Body, Motion]:
        motion = drive_among(robot, around, body, control, robots=others)
        return motion.body, motion

    begin = functools.partial(first_body, robot)(jnp.zeros(3))
    return jax.device_get(
        jax.jit(lambda: jax.lax.scan(step, begin, jnp.tile(jnp.array([0.8, 0.0, 0.0]), (STEPS, 1))))()
    )[1]


def test_a_robot_stops_another_one_as_a_post_does(tmp_path: Path):
    half_m = HEIGHT_M / 2
    post = Obstacles(NO_BOXES, np.array([[*AHEAD_M, half_m, RADIUS_M, half_m]]))
    at_post, at_robot = driven(tmp_path, post), driven(tmp_path, NOTHING, AHEAD_M, FAR_M)
    assert at_post.work.impulse_ns.max() > 0.01
    np.testing.assert_allclose(at_robot.body.qpos, at_post.body.qpos, atol=1e-5)
    assert at_robot.robots_ns is not None
    np.testing.assert_allclose(at_robot.robots_ns, at_post.work.impulse_ns, atol=1e-4)


def test_what_a_robot_pushes_is_no_solid_s(tmp_path: Path):
    motion = driven(tmp_path, NOTHING, AHEAD_M, FAR_M)
    assert not motion.work.impulse_ns.any()
    assert motion.clearance_m.min() > 1.0
    assert motion.work.push_ns[:, 0].min() < -0.01


def test_what_a_solid_pushes_is_no_robot_s(tmp_path: Path):
    motion, alone = driven(tmp_path, WALL, FAR_M), driven(tmp_path, WALL)
    assert motion.robots_ns is not None
    assert not motion.robots_ns.any()
    np.testing.assert_allclose(motion.work.impulse_ns, alone.work.impulse_ns, atol=1e-4)
    assert motion.work.impulse_ns.max() > 0.01
    assert alone.robots_ns is None
