"""How the courier gives way: who is a person in a scan, how it walks on, and what the courier does then."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from applications.courier.courier.giving_way import Planned, give_way, nobody, room_of
from applications.courier.courier.go_to_goal import Kept, controller
from applications.courier.courier.planning import RADIUS_M
from specs.data.people import PERSON_RADIUS_M
from tasks.simulate.application.contract import FloorMap, Observation
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map
from tests.factories.simulations import hall

CONTROL_S = 0.05
HALF_M = 4.0
LOW, HIGH = np.array([-2.45, -HALF_M + 0.05]), np.array([7.45, HALF_M - 0.05])
WORLD = hall(HALF_M)
FLOOR = FloorMap(*(jnp.asarray(field) for field in floor_map(WORLD, obstacles(WORLD, 0.02, 0.38))))
ROOM = room_of(FLOOR)
GOAL = jnp.array([5.0, 0.0])
AWAY = jnp.full(2, 100.0)
PLANNED = Planned(jnp.array([0.5, 0.25, 0.0]), jnp.float32(0.1), GOAL, jnp.float32(0.5))


def scan(pose: jax.Array, person_m: jax.Array) -> jax.Array:
    """Returns what the lidar sees of the hall's outer walls, and of a person in it."""
    angles = pose[2] + 2 * np.pi * jnp.arange(32) / 32
    way = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
    to_walls = jnp.where(way > 0, (HIGH - pose[:2]) / way, (LOW - pose[:2]) / way).min(axis=1)
    apart = person_m - pose[:2]
    along = way @ apart
    beside = jnp.sum(apart**2) - along**2
    to_person = along - jnp.sqrt(jnp.maximum(PERSON_RADIUS_M**2 - beside, 0.0))
    meets = (beside < PERSON_RADIUS_M**2) & (along > 0)
    return jnp.minimum(jnp.minimum(to_walls, jnp.where(meets, to_person, 10.0)), 10.0)


WAY_GIVEN = jax.jit(give_way)
AT = jnp.array([0.0, 0.0, 0.0])


def test_without_people_the_control_is_the_planned_one_bit_for_bit():
    people, control = WAY_GIVEN(nobody(), ROOM, AT, scan(AT, AWAY), PLANNED)
    np.testing.assert_array_equal(control, PLANNED.control)
    assert int(people.unseen.min()) > 10


@pytest.mark.parametrize("yaw", [0.0, 0.05, 0.11, 1.0, 3.0])
@pytest.mark.parametrize("distance_m", [0.8, 1.3])
def test_a_person_is_where_it_stands(yaw: float, distance_m: float):
    pose = AT.at[2].set(yaw)
    person_m = jnp.array([distance_m, 0.2])
    people, _ = WAY_GIVEN(nobody(), ROOM, pose, scan(pose, person_m), PLANNED)
    assert np.hypot(*(people.place_m[0] - person_m)) < 0.12
    assert np.asarray(people.unseen).tolist() == [0, 11, 11]


def test_a_robot_that_sees_nobody_does_as_planned_beside_one_that_sees_somebody():
    poses = jnp.stack([AT, AT])
    ranges = jnp.stack([scan(AT, AWAY), scan(AT, jnp.array([0.7, 0.0]))])
    many = jax.jit(jax.vmap(give_way, in_axes=(None, None, 0, 0, None)))
    _, controls = many(nobody(), ROOM, poses, ranges, PLANNED)
    np.testing.assert_array_equal(controls[0], PLANNED.control)
    assert float(controls[1, 0]) < float(controls[0, 0])


class Drive(NamedTuple):
    """A way of the robot and a person, step by step."""

    pose: np.ndarray
    person_m: np.ndarray
    velocity: np.ndarray


def driven(begin_m: tuple[float, float], walk_m_s: tuple[float, float], steps: int) -> Drive:
    """Returns how the courier drives to its goal while a person who does not see it walks straight on."""
    robot = controller({"MAX_SPEED": 0.5})
    nothing, no = jnp.zeros(3), jnp.zeros(0, bool)

    def step(
        carry: tuple[jax.Array, jax.Array, Kept], _: None
    ) -> tuple[tuple[jax.Array, jax.Array, Kept], tuple[jax.Array, jax.Array, jax.Array]]:
        pose, person_m, kept = carry
        seen = Observation(jnp.zeros(()), pose, nothing, scan(pose, person_m), jnp.int32(0), GOAL, nothing[:2], no)
        kept, control = robot.step(kept, seen)
        yaw = pose[2] + CONTROL_S * control[1]
        there = pose[:2] + CONTROL_S * control[0] * jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
        there = jnp.where(jnp.sum((pose[:2] - GOAL) ** 2) < 0.3**2, pose[:2], there)
        walked_m = person_m + CONTROL_S * jnp.array(walk_m_s)
        after = jnp.append(there, yaw)
        return (after, walked_m, kept), (after, walked_m, kept.people.velocity[0])

    begin = (AT, jnp.array(begin_m), robot.init(FLOOR, GOAL[None]))
    _, ways = jax.jit(lambda: jax.lax.scan(step, begin, None, length=steps))()
    return Drive(*map(np.asarray, ways))


def gaps_m(drive: Drive) -> np.ndarray:
    return np.hypot(*(drive.pose[:, :2] - drive.person_m).T) - RADIUS_M - PERSON_RADIUS_M


@pytest.mark.parametrize(
    ("begin_m", "walk_m_s"),
    [
        ((4.0, 0.0), (-1.0, 0.0)),
        ((4.0, 0.1), (-0.8, 0.0)),
        ((2.0, 2.0), (-0.5, -0.9)),
        ((2.0, -2.4), (0.0, 0.9)),
        ((2.5, 0.0), (0.0, 0.0)),
    ],
)
def test_it_goes_around_who_walks_into_its_way_or_stands_in_it_and_arrives(
    begin_m: tuple[float, float], walk_m_s: tuple[float, float]
):
    drive = driven(begin_m, walk_m_s, 500)
    assert gaps_m(drive).min() > 0.05
    assert np.hypot(*(drive.pose[-1, :2] - np.asarray(GOAL))) < 0.35


def test_it_takes_a_person_to_walk_as_it_walks():
    drive = driven((3.0, 1.5), (-0.8, 0.0), 50)
    assert np.hypot(*(drive.velocity[40] - np.array([-0.8, 0.0]))) < 0.25


def test_it_is_slow_towards_a_person_right_before_it():
    for distance_m, most_m_s in ((0.55, 0.2), (0.75, 0.3)):
        pose = AT
        _, control = WAY_GIVEN(nobody(), ROOM, pose, scan(pose, jnp.array([distance_m, 0.0])), PLANNED)
        assert float(control[0]) < most_m_s < float(PLANNED.control[0])
