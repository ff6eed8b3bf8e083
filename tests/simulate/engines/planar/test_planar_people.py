"""People on the planar engine: they stop a robot as posts do, and are told apart from solids."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tests.factories.planar import NO_BOXES, NO_CYLINDERS, Obstacles, box, on_device, padded, read, write_robot

STEPS = 40
NOTHING = Obstacles(NO_BOXES, NO_CYLINDERS)
WALL = Obstacles(np.array([box(0.6, 0.0, 0.1, 2.0)]), NO_CYLINDERS)
AHEAD_M, FAR_M = (0.7, 0.05), (40.0, 40.0)


def driven(folder: Path, obstacles: Obstacles, *people_m: tuple[float, float]) -> Motion:
    """Returns what two seconds straight ahead are, with people who stand somewhere."""
    robot = read(write_robot(folder, {}))
    around = on_device(padded(obstacles))
    standing = jnp.asarray(people_m) if people_m else None

    def step(body: Body, control: jax.Array) -> tuple[Body, Motion]:
        motion = drive_among(robot, around, body, control, people_m=standing)
        return motion.body, motion

    begin = functools.partial(first_body, robot)(jnp.zeros(3))
    return jax.device_get(
        jax.jit(lambda: jax.lax.scan(step, begin, jnp.tile(jnp.array([0.8, 0.0, 0.0]), (STEPS, 1))))()
    )[1]


def test_a_person_stops_a_robot_as_a_post_does(tmp_path: Path):
    half_m = PERSON_HEIGHT_M / 2
    post = Obstacles(NO_BOXES, np.array([[*AHEAD_M, half_m, PERSON_RADIUS_M, half_m]]))
    at_post, at_person = driven(tmp_path, post), driven(tmp_path, NOTHING, AHEAD_M, FAR_M)
    assert at_post.work.impulse_ns.max() > 0.01
    np.testing.assert_allclose(at_person.body.qpos, at_post.body.qpos, atol=1e-5)
    assert at_person.people is not None
    np.testing.assert_allclose(at_person.people.impulse_ns, at_post.work.impulse_ns, atol=1e-4)
    np.testing.assert_allclose(at_person.people.distance_m, at_post.clearance_m, atol=1e-5)


def test_what_a_person_pushes_is_no_solid_s(tmp_path: Path):
    motion = driven(tmp_path, NOTHING, AHEAD_M, FAR_M)
    assert motion.people is not None
    assert motion.people.impulse_ns.max() > 0.01
    assert not motion.work.impulse_ns.any()
    assert motion.clearance_m.min() > 1.0
    assert motion.work.push_ns[:, 0].min() < -0.01


def test_what_a_solid_pushes_is_nobody_s(tmp_path: Path):
    motion, still = driven(tmp_path, WALL, FAR_M, FAR_M), driven(tmp_path, WALL)
    assert motion.people is not None
    assert not motion.people.impulse_ns.any()
    assert motion.people.distance_m.min() > 10.0
    np.testing.assert_allclose(motion.work.impulse_ns, still.work.impulse_ns, atol=1e-4)
    assert motion.work.impulse_ns.max() > 0.01


def test_without_people_nothing_is_said_of_them(tmp_path: Path):
    assert driven(tmp_path, WALL).people is None
