"""Several robots in a world: each is a lane of its own, and sees those of the lanes beside it as upright cylinders.

The lanes of a world lie side by side. Before a control step each is handed where the others are then; while an engine
drives it, they stand there. A robot that is done stays where it is until all of them are.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.episode import CONTROL_HZ
from specs.data.robots import BLOCKED_M, STILL_M, STILL_S
from tasks.simulate.application.contract import DEADLOCK, STUCK, TIMEOUT, Body
from tasks.simulate.geometry.walks import Arrays

_STILL_STEPS = round(STILL_S * CONTROL_HZ)


class RobotsInputs(NamedTuple):
    """The robots that a lane's shares its world with, in the order of their numbers.

    Attributes:
        start_m: Where each begins (x, y).
        radius_m: Of the circle around the hull of each.
        low_m, high_m: Where it begins and ends above the floor.
        own_radius_m: Of the lane's own robot.
    """

    start_m: Float[Arrays, "*lanes robots 2"]
    radius_m: Float[Arrays, "*lanes robots"]
    low_m: Float[Arrays, "*lanes robots"]
    high_m: Float[Arrays, "*lanes robots"]
    own_radius_m: Float[Arrays, "*lanes"]


class Others(NamedTuple):
    """How these robots are before a control step.

    Attributes:
        place_m: Where each is (x, y).
        velocity: How it moves (m/s); not at all if it is done.
        still: Whether it stands still, or is done.
        everyone: All robots of the world, the lane's own among them, in the order of their numbers: (x, y) and
            velocity. So all its lanes have the same people. None before the first step.
    """

    place_m: Float[jax.Array, "*lanes robots 2"]
    velocity: Float[jax.Array, "*lanes robots 2"]
    still: Bool[jax.Array, "*lanes robots"]
    everyone: Float[jax.Array, "*lanes all 4"] | None = None


class RobotsState(NamedTuple):
    """How a robot met others until now, and whether it gets on; fields as in EpisodeResult.

    Attributes:
        anchor_m: Where it stood when it last got on.
        still_steps: For how many control steps it has not.
        place_m: Where the others are (x, y), or were when it was done.
    """

    contacts: Int[jax.Array, ""]
    touching: Bool[jax.Array, ""]
    contact_m_s: Float[jax.Array, ""]
    least_m: Float[jax.Array, "*lanes"]
    anchor_m: Float[jax.Array, "2"]
    still_steps: Int[jax.Array, "*lanes"]
    place_m: Float[jax.Array, "*lanes robots 2"]


def begin_robots(robots: RobotsInputs, start: Float[jax.Array, "3"]) -> RobotsState:
    """Returns how a robot has met others before the first control step: not at all."""
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    return RobotsState(none, jnp.zeros((), bool), zero, jnp.full((), jnp.inf), start[:2], none, robots.start_m)


def first_others(robots: RobotsInputs) -> Others:
    """Returns the others of one lane before the first control step: at rest where they begin."""
    return Others(robots.start_m, jnp.zeros_like(robots.start_m), jnp.zeros(len(robots.start_m), bool))


def others_of(
    robots: RobotsInputs, body: Body, done: Bool[jax.Array, "lanes"], still_steps: Int[jax.Array, "lanes"]
) -> Others:
    """Returns the others of all lanes; those of a world lie side by side.

    Args:
        robots: Of all lanes.
        body: Likewise, with whether each is done, and for how long it has not got on.
        done: Likewise.
        still_steps: Likewise.
    """
    velocity, sharing = jnp.where(done[:, None], 0.0, body.qvel[:, :2]), robots.radius_m.shape[1] + 1
    together = jnp.concatenate([body.qpos[:, :2], velocity], axis=1).reshape(-1, sharing, 4)
    return Others(
        *(_beside(robots, each) for each in (body.qpos[:, :2], velocity, done | (still_steps >= _STILL_STEPS))),
        everyone=jnp.repeat(together, sharing, axis=0),
    )


def _beside(robots: RobotsInputs, own: jax.Array) -> jax.Array:
    """Returns what the other lanes of each world have."""
    lanes, others = robots.radius_m.shape
    together = own.reshape(-1, others + 1, *own.shape[1:])
    which = np.array([[each for each in range(others + 1) if each != number] for number in range(others + 1)])
    return together[:, which].reshape(lanes, others, *own.shape[1:])


def apart_m(robots: RobotsInputs, place_m: Float[jax.Array, "2"], others: Others) -> Float[jax.Array, "robots"]:
    """Returns how far each of the others is from a robot, circle to circle."""
    away_m = jnp.sqrt(jnp.sum((others.place_m - place_m) ** 2, axis=-1))
    return away_m - robots.radius_m - robots.own_radius_m


def meet_others(
    state: RobotsState, others: Others, before: Body, after: Body, impulse_ns: Float[jax.Array, ""]
) -> RobotsState:
    """Returns how one lane's robot met others until the end of a control step, but for how near it came to them.

    Args:
        state: Until the step.
        others: Before it.
        before: The robot at its beginning.
        after: At its end.
        impulse_ns: What the others pushed it with.
    """
    touching = impulse_ns > 0.0
    begins = touching & ~state.touching
    nearest = jnp.argmin(jnp.sum((others.place_m - before.qpos[:2]) ** 2, axis=1))
    speed = jnp.sqrt(jnp.sum((others.velocity[nearest] - before.qvel[:2]) ** 2))
    gone = jnp.sum((after.qpos[:2] - state.anchor_m) ** 2) > STILL_M**2
    return state._replace(
        contacts=state.contacts + begins,
        touching=touching,
        contact_m_s=jnp.where(begins, jnp.maximum(state.contact_m_s, speed), state.contact_m_s),
        anchor_m=jnp.where(gone, after.qpos[:2], state.anchor_m),
        still_steps=jnp.where(gone, 0, state.still_steps + 1),
    )


def nearest_yet_m(robots: RobotsInputs, state: RobotsState, body: Body, others: Others) -> Float[jax.Array, ""]:
    """Returns how near one lane's robot came to others until now: what does not push it is at least beside it."""
    now_m = apart_m(robots, body.qpos[:2], others).min()
    return jnp.minimum(state.least_m, jnp.where(state.touching, now_m, jnp.maximum(now_m, 0.0)))


def with_deadlock(
    reason: Int[jax.Array, ""], robots: RobotsInputs, state: RobotsState, others: Others, place_m: Float[jax.Array, "2"]
) -> Int[jax.Array, ""]:
    """Returns the reason of a verdict: whoever is stuck, or too late, beside one that stands still is in a deadlock.

    Args:
        reason: As the scenario has it.
        robots: One lane's.
        state: Its robot's, after the step.
        others: Before it.
        place_m: Where the robot is then.
    """
    blocked = (others.still & (apart_m(robots, place_m, others) < BLOCKED_M)).any()
    stands = state.still_steps >= _STILL_STEPS
    return jnp.where(((reason == STUCK) | (reason == TIMEOUT)) & stands & blocked, DEADLOCK, reason)


def robot_circles(robots: RobotsInputs, others: Others, height_m: float) -> Float[jax.Array, "robots 3"]:
    """Returns robots as a lidar sees them: circles (x, y, radius), of no size for one that its plane misses."""
    met = (robots.low_m <= height_m) & (height_m < robots.high_m)
    return jnp.concatenate([others.place_m, jnp.where(met, robots.radius_m, 0.0)[:, None]], axis=1)


def robot_cylinders(robots: RobotsInputs, place_m: Float[jax.Array, "robots 2"]) -> Float[jax.Array, "robots 5"]:
    """Returns robots as a depth camera sees them: cylinders (x, y, lowest, highest, radius)."""
    return jnp.concatenate([place_m, jnp.stack([robots.low_m, robots.high_m, robots.radius_m], axis=1)], axis=1)
