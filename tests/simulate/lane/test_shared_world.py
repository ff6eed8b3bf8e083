"""Robots that share a world: who sees whom, how near they were, and when they are in a deadlock."""

import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.outcomes import OutcomeReason
from specs.data.robots import BLOCKED_M, STILL_S
from tasks.simulate.application.contract import REASONS, Body
from tasks.simulate.lane.shared_world import (
    Others,
    RobotsInputs,
    begin_robots,
    meet_others,
    nearest_yet_m,
    others_of,
    robot_circles,
    robot_cylinders,
    with_deadlock,
)

RADIUS_M, LOW_M, HIGH_M = 0.2, 0.05, 0.4
STILL_STEPS = round(STILL_S * 20)


def one_lane(*places_m: tuple[float, float]) -> RobotsInputs:
    alike = jnp.ones(len(places_m))
    return RobotsInputs(jnp.asarray(places_m), RADIUS_M * alike, LOW_M * alike, HIGH_M * alike, jnp.float32(RADIUS_M))


def body(x_m: float, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Body:
    return Body(jnp.array([x_m, 0.0, 0.0]), jnp.array(velocity), jnp.zeros(0), jnp.zeros(3))


def test_each_lane_is_handed_the_others_of_its_world_in_their_order():
    lanes = 6
    pairs = jnp.zeros((lanes, 2))
    inputs = RobotsInputs(jnp.zeros((lanes, 2, 2)), pairs, pairs, pairs, jnp.zeros(lanes))
    poses = jnp.stack([jnp.arange(lanes), jnp.arange(lanes), jnp.zeros(lanes)], axis=1).astype(jnp.float32)
    bodies = Body(poses, 10.0 * poses, jnp.zeros((lanes, 0)), jnp.zeros((lanes, 3)))
    done = jnp.arange(lanes) == 1
    still = jnp.where(jnp.arange(lanes) == 5, STILL_STEPS, 0)
    others = others_of(inputs, bodies, done, still)
    beside = [[1, 2], [0, 2], [0, 1], [4, 5], [3, 5], [3, 4]]
    np.testing.assert_array_equal(others.place_m[..., 0], beside)
    moving = [[0.0 if each == 1 else 10.0 * each for each in pair] for pair in beside]
    np.testing.assert_array_equal(others.velocity[..., 0], moving)
    np.testing.assert_array_equal(others.still, [[each in {1, 5} for each in pair] for pair in beside])


def test_a_lidar_sees_the_robots_that_its_plane_crosses_and_a_camera_all():
    robots = one_lane((1.0, 2.0))
    others = Others(robots.start_m, jnp.zeros((1, 2)), jnp.zeros(1, bool))
    np.testing.assert_allclose(robot_circles(robots, others, 0.2), [[1.0, 2.0, RADIUS_M]])
    for height_m in (0.0, HIGH_M):
        np.testing.assert_allclose(robot_circles(robots, others, height_m), [[1.0, 2.0, 0.0]])
    np.testing.assert_allclose(robot_cylinders(robots, others.place_m), [[1.0, 2.0, LOW_M, HIGH_M, RADIUS_M]])


def test_a_contact_is_counted_once_with_the_speed_at_which_it_began():
    robots = one_lane((0.39, 0.0), (9.0, 9.0))
    others = Others(robots.start_m, jnp.array([[-0.3, 0.0], [7.0, 0.0]]), jnp.zeros(2, bool))
    state = begin_robots(robots, jnp.zeros(3))
    fast, slow = body(0.0, (0.5, 0.0, 0.0)), body(0.0, (0.1, 0.0, 0.0))
    for impulse_ns, before in ((0.0, fast), (0.4, fast), (0.4, slow), (0.0, slow), (0.1, slow)):
        state = meet_others(state, others, before, before, jnp.float32(impulse_ns))
    assert int(state.contacts) == 2
    assert float(state.contact_m_s) == pytest.approx(0.8)
    near = nearest_yet_m(robots, state, body(0.0), others)
    assert float(near) == pytest.approx(-0.01, abs=1e-6)
    beside = nearest_yet_m(robots, state._replace(touching=jnp.zeros((), bool)), body(0.0), others)
    assert float(beside) == 0.0


@pytest.mark.parametrize(
    ("reason", "apart_m", "steps", "still", "becomes"),
    [
        ("stuck", 0.1, STILL_STEPS, 1, "deadlock"),
        ("timeout", 0.1, STILL_STEPS, 1, "deadlock"),
        ("stuck", BLOCKED_M + 0.01, STILL_STEPS, 1, "stuck"),
        ("stuck", 0.1, STILL_STEPS, 0, "stuck"),
        ("timeout", 0.1, STILL_STEPS - 1, 1, "timeout"),
        ("collision", 0.1, STILL_STEPS, 1, "collision"),
        ("", 0.1, STILL_STEPS, 1, ""),
    ],
)
def test_who_stands_beside_one_that_stands_is_in_a_deadlock(
    reason: OutcomeReason, apart_m: float, steps: int, still: int, becomes: OutcomeReason
):
    robots = one_lane((2 * RADIUS_M + apart_m, 0.0))
    others = Others(robots.start_m, jnp.zeros((1, 2)), jnp.array([still > 0]))
    state = begin_robots(robots, jnp.zeros(3))._replace(still_steps=jnp.int32(steps))
    found = with_deadlock(jnp.int32(REASONS.index(reason)), robots, state, others, jnp.zeros(2))
    assert REASONS[int(found)] == becomes


def test_a_robot_that_goes_on_stands_no_longer():
    robots = one_lane((5.0, 0.0))
    others = Others(robots.start_m, jnp.zeros((1, 2)), jnp.zeros(1, bool))
    state = begin_robots(robots, jnp.zeros(3))
    for x_m, steps in ((0.05, 1), (0.1, 2), (0.2, 0), (0.3, 1)):
        state = meet_others(state, others, body(x_m), body(x_m), jnp.float32(0.0))
        assert int(state.still_steps) == steps
