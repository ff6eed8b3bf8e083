"""The wanderer's controller: no map, no plan; it goes by what its lidar and its bumper say now.

Towards a goal it takes the open direction nearest to it. Where that leads away from it, it follows the wall until it is
nearer to the goal than ever before and the goal's direction is open (I. Kamon, E. Rivlin and E. Rimon, TangentBug,
1998). Without a goal it follows walls, and now and then leaves them for the open. What it runs into it backs off from,
and turns somewhere.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from .gaps import Host, along_wall, between, free_ways_m, towards

if TYPE_CHECKING:
    from tasks.simulate.application.contract import Observation

Number = float | Float[jax.Array, ""]
RADIUS_M = 0.16
HALF_TRACK_M = 0.13
DEFAULT_SPEED_M_S = 0.4
_MARGIN_M = 0.08
# A direction is open when the hull can go so far, or to the goal.
_OPEN_M = 0.6
# A goal that lies farther than this off the best open direction is behind a wall.
_AWAY_RAD = 1.4
_NEARER_M = 0.2
# A wall is followed the other way round when the goal did not come nearer for so long: least, and by chance more.
_LEAST_PATIENCE_S, _MORE_PATIENCE_S = 45.0, 45.0
# Without a goal a wall is followed, and then the open crossed, for so long.
_LEAST_FOLLOWED_S, _MORE_FOLLOWED_S = 20.0, 25.0
_LEAST_CROSSED_S, _MORE_CROSSED_S = 3.0, 6.0
# After a bump, or when nothing moved for a while, it backs off, turns, and goes straight on for a bit.
_STILL_S, _STILL_M_S = 2.0, 0.08
_BACKING_S, _TURNING_S, _PASSING_S = 0.6, 0.8, 1.5
_BACKING_M_S = -0.12
_TURN_GAIN, _MOST_TURN_RAD_S = 2.5, 2.2
_BRAKE_M_S2, _GAP_M = 0.6, 0.03
_HEADINGS_RAD = np.linspace(-0.7 * np.pi, 0.7 * np.pi, 49)


class Lidar(NamedTuple):
    """A planar lidar that does not see what is behind it, above the axle."""

    rays: int = 61
    range_m: float = 6.0
    height_m: float = 0.16
    fov_rad: float = 1.5 * np.pi
    sigma_m: Number = 0.0
    dropout: Number = 0.0


class Bumper(NamedTuple):
    """Contact switches all around."""

    sectors: int = 8


class Mood(NamedTuple):
    """What it is about.

    Attributes:
        side: Where the wall is that it follows: 1 left, -1 right, 0 for none.
        until_s: When it is tired of that.
        best_m: How near to the goal it was, since the goal is its goal.
        goal_index: Which goal that is.
        bumped_s: When it last ran into something.
        moved_s: When it last moved.
        turn_rad_s: How it turns then.
        dice: What chance is made of.
    """

    side: Int[jax.Array, ""]
    until_s: Float[jax.Array, ""]
    best_m: Float[jax.Array, ""]
    goal_index: Int[jax.Array, ""]
    bumped_s: Float[jax.Array, ""]
    moved_s: Float[jax.Array, ""]
    turn_rad_s: Float[jax.Array, ""]
    dice: UInt32[jax.Array, ""]


class Wanderer:
    """Goes to goals when it seeks them, else about."""

    bumper = Bumper()

    def __init__(self, most_m_s: Number, seek: Number, lidar: Lidar) -> None:
        self._most_m_s, self._seek, self.lidar = most_m_s, seek, lidar

    def init(self, floor: Any, goals_m: Float[jax.Array, "goals 2"]) -> Mood:  # noqa: ANN401, ARG002 - no map
        """Returns the mood to begin with; the map is not looked at, and of the goals only dice are made."""
        none, zero = jnp.zeros((), jnp.int32), jnp.zeros(())
        never = jnp.full((), -1e3)
        centimetres = jnp.round(100.0 * goals_m[0]).astype(jnp.int32).astype(jnp.uint32)
        dice = _thrown(centimetres[0] + jnp.uint32(65537) * centimetres[1])
        return Mood(none, zero, jnp.full((), jnp.inf), none, never, zero, zero + 1.0, dice)

    def step(self, state: Mood, observation: "Observation") -> tuple[Mood, Float[jax.Array, "3"]]:
        """Returns the mood, and the control (left wheel m/s, right wheel m/s, sideways m/s)."""
        seeks = jnp.asarray(self._seek) > 0.0
        ways = self._ways_m(observation.ranges_m, _HEADINGS_RAD, RADIUS_M + _MARGIN_M)
        to_goal = jnp.sqrt(jnp.sum(observation.goal_robot_m**2))
        needed = jnp.where(seeks, jnp.minimum(_OPEN_M, to_goal), _OPEN_M)
        is_open = ways > needed
        mood = _noticed(state, observation)
        passing = observation.time_s - mood.bumped_s < _BACKING_S + _TURNING_S + _PASSING_S
        bearing = jnp.where(
            seeks & ~passing, jnp.arctan2(observation.goal_robot_m[1], observation.goal_robot_m[0]), 0.0
        )
        onwards = towards(bearing, is_open, _HEADINGS_RAD)
        headings = jnp.asarray(_HEADINGS_RAD, jnp.float32)
        sought = _seeking(mood, observation, to_goal, between(headings[onwards], bearing), is_open)
        mood = jax.tree.map(lambda one, other: jnp.where(seeks, one, other), sought, _roaming(mood, observation, ways))
        beside = along_wall(mood.side, observation.ranges_m, _angles_rad(self.lidar), is_open, _HEADINGS_RAD)
        changed = (mood.side != state.side) | (mood.bumped_s != state.bumped_s)
        mood = mood._replace(dice=jnp.where(changed, _thrown(mood.dice), mood.dice))
        chosen = jnp.where((mood.side == 0) | passing, onwards, beside)
        chosen = jnp.where(is_open.any(), chosen, jnp.argmax(ways))
        return mood, self._control(mood, observation, headings[chosen], ways)

    def _control(self, mood: Mood, observation: "Observation", heading_rad: jax.Array, ways: jax.Array) -> jax.Array:
        """Returns the wheels' speeds to go where it heads; after a bump, to back off and turn."""
        free_m = self._ways_m(observation.ranges_m, np.zeros(1), RADIUS_M + 0.01)[0]
        stopping = jnp.sqrt(2.0 * _BRAKE_M_S2 * jnp.maximum(free_m - _GAP_M, 0.0))
        ahead = jnp.minimum(self._most_m_s * jnp.maximum(jnp.cos(heading_rad), 0.0) ** 2, stopping)
        turn = jnp.clip(_TURN_GAIN * heading_rad, -_MOST_TURN_RAD_S, _MOST_TURN_RAD_S)
        # In a dead end the way out may be where the lidar does not see.
        lost = jnp.max(ways) < _GAP_M
        ahead, turn = jnp.where(lost, 0.0, ahead), jnp.where(lost, mood.turn_rad_s, turn)
        since_s = observation.time_s - mood.bumped_s
        backing, turning = since_s < _BACKING_S, since_s < _BACKING_S + _TURNING_S
        ahead = jnp.where(backing, _BACKING_M_S, jnp.where(turning, 0.0, ahead))
        turn = jnp.where(backing, 0.0, jnp.where(turning, mood.turn_rad_s, turn))
        return jnp.stack([ahead - HALF_TRACK_M * turn, ahead + HALF_TRACK_M * turn, jnp.zeros_like(turn)])

    def _ways_m(self, ranges_m: jax.Array, headings_rad: Host, radius_m: float) -> Float[jax.Array, "headings"]:
        return free_ways_m(ranges_m, _angles_rad(self.lidar), headings_rad, radius_m, self.lidar.range_m)


def controller(environment: Mapping[str, str | Number]) -> Wanderer:
    """Returns the controller.

    Args:
        environment: MAX_SPEED is the speed limit in metres a second; SEEK 0 makes it roam whatever goals there are;
            LIDAR_SIGMA (m) and LIDAR_DROPOUT (a share) say how bad its lidar is.

    Raises:
        ValueError: One of them is not a number.
    """
    lidar = Lidar(sigma_m=_number(environment, "LIDAR_SIGMA", 0.0), dropout=_number(environment, "LIDAR_DROPOUT", 0.0))
    speed = _number(environment, "MAX_SPEED", DEFAULT_SPEED_M_S)
    return Wanderer(speed, _number(environment, "SEEK", 1.0), lidar)


def _number(environment: Mapping[str, str | Number], name: str, default: float) -> Number:
    value = environment.get(name, default)
    if isinstance(value, str):
        raise ValueError(f"{name}: {value!r}: must be a number")  # noqa: TRY004 - the text is the wrong value of a variable
    return value


def _angles_rad(lidar: Lidar) -> Host:
    """Returns the directions of the lidar's rays, from the right to the left."""
    return np.linspace(-lidar.fov_rad / 2, lidar.fov_rad / 2, lidar.rays)


def _noticed(mood: Mood, observation: "Observation") -> Mood:
    """Returns the mood with the bump noticed, and the best distance forgotten when the goal is a new one."""
    now_s = observation.time_s
    moves = jnp.sqrt(jnp.sum(observation.velocity[:2] ** 2)) > _STILL_M_S
    bumped = observation.bumper.any() | (now_s - mood.moved_s > _STILL_S)
    bumped &= now_s - mood.bumped_s > _BACKING_S + _TURNING_S
    renewed = observation.goal_index != mood.goal_index
    return mood._replace(
        bumped_s=jnp.where(bumped, now_s, mood.bumped_s),
        moved_s=jnp.where(bumped | moves, now_s, mood.moved_s),
        turn_rad_s=jnp.where(
            bumped,
            jnp.where(_chance(mood.dice, 16) < 0.5, 1.0, -1.0) * (1.0 + 2.5 * _chance(mood.dice, 24)),
            mood.turn_rad_s,
        ),
        best_m=jnp.where(renewed, jnp.inf, mood.best_m),
        side=jnp.where(renewed, 0, mood.side),
        goal_index=observation.goal_index,
    )


def _seeking(
    mood: Mood, observation: "Observation", to_goal_m: jax.Array, off_rad: jax.Array, is_open: Bool[jax.Array, "rays"]
) -> Mood:
    """Returns the mood of one that has a goal.

    Args:
        mood: That before.
        observation: What it senses.
        to_goal_m: How far the goal is.
        off_rad: How far the best open direction is turned from the goal's.
        is_open: Which directions are open.
    """
    now_s, following = observation.time_s, mood.side != 0
    blocked = (jnp.abs(off_rad) > _AWAY_RAD) | ~is_open.any()
    # Turned to the left of the goal, it has what is in the way on its right.
    begun = ~following & blocked
    side = jnp.where(begun, jnp.where(off_rad > 0.0, -1, 1), mood.side)
    leaves = following & (to_goal_m < mood.best_m - _NEARER_M) & (jnp.abs(off_rad) < 0.3)
    tired = following & (now_s > mood.until_s)
    # What took so long is tried the other way round.
    side = jnp.where(leaves, 0, jnp.where(tired, -side, side))
    patience_s = _LEAST_PATIENCE_S + _MORE_PATIENCE_S * _chance(mood.dice, 8)
    return mood._replace(
        side=side.astype(jnp.int32),
        until_s=jnp.where(begun | tired, now_s + patience_s, mood.until_s),
        best_m=jnp.where(following & ~leaves, mood.best_m, jnp.minimum(mood.best_m, to_goal_m)),
    )


def _roaming(mood: Mood, observation: "Observation", ways: Float[jax.Array, "rays"]) -> Mood:
    """Returns the mood of one that has none: walls for a while, on either side, then the open until it meets one."""
    now_s, following = observation.time_s, mood.side != 0
    blocked = ways[ways.shape[0] // 2] < _OPEN_M
    over = (now_s > mood.until_s) | (~following & blocked)
    side = jnp.where(following, 0, jnp.where(_chance(mood.dice, 16) < 0.5, 1, -1))
    chance = _chance(mood.dice, 8)
    lasts_s = jnp.where(
        following, _LEAST_CROSSED_S + _MORE_CROSSED_S * chance, _LEAST_FOLLOWED_S + _MORE_FOLLOWED_S * chance
    )
    return mood._replace(
        side=jnp.where(over, side, mood.side).astype(jnp.int32),
        until_s=jnp.where(over, now_s + lasts_s, mood.until_s),
    )


def _thrown(dice: UInt32[jax.Array, ""]) -> UInt32[jax.Array, ""]:
    """Returns the dice thrown again: a linear congruential generator.

    They are thrown when something happens, not as time goes by, so that another engine's last bits do not change them.
    """
    return dice * jnp.uint32(1664525) + jnp.uint32(1013904223)


def _chance(dice: UInt32[jax.Array, ""], bits: int) -> Float[jax.Array, ""]:
    """Returns a number from 0 to 1, from eight of the dice's bits."""
    return ((dice >> bits) & jnp.uint32(255)).astype(jnp.float32) / 255.0
