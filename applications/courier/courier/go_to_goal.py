"""The courier's controller: plans on the map, follows the plan, keeps off what its lidar sees, and gives way to people.

Wherever its sensors are ideal, so is the program: noise costs only those who ask for it.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from .giving_way import People, Planned, Room, give_way, nobody, room_of
from .localizing import Belief, belief_at_start, corrected, matched
from .planning import RADIUS_M, Ways, point_ahead, ways_to_goals
from .scan import Lidar, Number, angles_rad, free_ahead, ray_directions

if TYPE_CHECKING:
    from tasks.simulate.application.contract import FloorMap, Observation

DEFAULT_SPEED_M_S = 0.5
# A point farther on would lead across the corners of what the lidar does not see.
_AHEAD_M = 0.6
_TURN_GAIN = 3.0
_MOST_TURN_RAD_S = 2.5
# Solids nearer than this to the hull push the heading away.
_PUSH_M = 0.18
_PUSH_GAIN = 1.2
# Deceleration to plan on, and the gap to keep from what is straight ahead.
_BRAKE_M_S2 = 0.8
_GAP_M = 0.04
_LEAST_SPEED_M_S = 0.05


class Odometry(NamedTuple):
    """How the pose that the wheels count drifts, after a metre and after a radian."""

    sigma_m_per_m: Number
    sigma_rad_per_m: Number
    sigma_rad_per_rad: Number


class Kept(NamedTuple):
    """The plan, whom it knows of, and where a robot that counts its wheels' turns believes to be.

    Attributes:
        belief: None for a robot that knows where it is.
    """

    ways: Ways
    room: Room
    people: People
    belief: Belief | None


class GoToGoal:
    """Follows the ways to the current goal at up to MAX_SPEED metres a second."""

    def __init__(self, most_m_s: Number, lidar: Lidar, odometry: Odometry | None = None) -> None:
        self._most_m_s = most_m_s
        self.lidar = lidar
        self.odometry = odometry

    def init(self, floor: "FloorMap", goals_m: Float[jax.Array, "goals 2"]) -> Kept:
        """Returns the plan: ways to all goals."""
        belief = None if self.odometry is None else belief_at_start(floor)
        return Kept(ways_to_goals(floor, goals_m), room_of(floor), nobody(), belief)

    def step(self, state: Kept, observation: "Observation") -> tuple[Kept, Float[jax.Array, "3"]]:
        """Returns the plan as it is, whom it knows of, and the control (forward m/s, turn rad/s, sideways m/s)."""
        belief, pose = state.belief, observation.pose
        if belief is not None:
            belief = matched(
                belief,
                pose,
                observation.ranges_m,
                jnp.asarray(angles_rad()),
                self.lidar.range_m,
            )
            pose = corrected(belief, pose)
        place, yaw = pose[:2], pose[2]
        ahead = point_ahead(state.ways, observation.goal_index, place, _AHEAD_M)
        close = jnp.sum((observation.goal_m - place) ** 2) < _AHEAD_M**2
        target = jnp.where(close, observation.goal_m, ahead)
        heading_x, heading_y = _heading(target - place, yaw, observation.ranges_m)
        error = jnp.arctan2(heading_y, heading_x)
        turn = jnp.clip(_TURN_GAIN * error, -_MOST_TURN_RAD_S, _MOST_TURN_RAD_S)
        forward = self._speed(error, observation.ranges_m)
        planned = Planned(
            jnp.stack([forward, turn, jnp.zeros_like(turn)]),
            error,
            target,
            jnp.asarray(self._most_m_s),
        )
        people, control = give_way(state.people, state.room, pose, observation.ranges_m, planned)
        return state._replace(people=people, belief=belief), control

    def _speed(self, error: jax.Array, ranges_m: Float[jax.Array, "rays"]) -> jax.Array:
        """Returns the speed that suits the turn to make, and lets it stop before what lies ahead."""
        free_m = jnp.min(free_ahead(ranges_m))
        stopping = jnp.sqrt(2.0 * _BRAKE_M_S2 * jnp.maximum(free_m - _GAP_M, 0.0))
        aligned = jnp.maximum(jnp.cos(error), 0.0) ** 2
        creeping = jnp.where(free_m > _GAP_M, _LEAST_SPEED_M_S * aligned, 0.0)
        return jnp.minimum(jnp.maximum(self._most_m_s * aligned, creeping), stopping)


def controller(environment: Mapping[str, str | Number]) -> GoToGoal:
    """Returns the controller.

    Args:
        environment: MAX_SPEED is the speed limit in metres a second; LIDAR_SIGMA, LIDAR_DROPOUT and ODOMETRY_SIGMA
            say how bad the sensors are. Without ODOMETRY_SIGMA the robot knows its pose.

    Raises:
        ValueError: One of them is not a number.
    """
    lidar = Lidar(
        sigma_m=_number(environment, "LIDAR_SIGMA", 0.0, "metres, such as 0.02"),
        dropout=_number(environment, "LIDAR_DROPOUT", 0.0, "lost rays among all, such as 0.05"),
    )
    odometry = None
    if "ODOMETRY_SIGMA" in environment:
        odometry = Odometry(*[_number(environment, "ODOMETRY_SIGMA", 0.0, "metres a metre, such as 0.01")] * 3)
    return GoToGoal(
        _number(environment, "MAX_SPEED", DEFAULT_SPEED_M_S, "metres a second, such as 0.5"),
        lidar,
        odometry,
    )


def _number(environment: Mapping[str, str | Number], name: str, default: float, meaning: str) -> Number:
    value = environment.get(name, default)
    if isinstance(value, str):
        raise ValueError(f"{name}: {value!r}: must be a number of {meaning}")  # noqa: TRY004 - the text is the wrong value of a variable
    return value


def _heading(
    way_m: Float[jax.Array, "2"],
    yaw: Float[jax.Array, ""],
    ranges_m: Float[jax.Array, "rays"],
) -> tuple[jax.Array, jax.Array]:
    """Returns where to go in the robot's frame: towards the target, pushed off by near solids."""
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    length = jnp.sqrt(jnp.sum(way_m**2)) + 1e-6
    to_x, to_y = (
        (cos * way_m[0] + sin * way_m[1]) / length,
        (cos * way_m[1] - sin * way_m[0]) / length,
    )
    ray_x, ray_y = ray_directions()
    push = _PUSH_GAIN * jnp.maximum(1.0 - jnp.maximum(ranges_m - RADIUS_M, 0.0) / _PUSH_M, 0.0) ** 2
    strongest = jnp.argmax(push)
    return to_x - push[strongest] * ray_x[strongest], to_y - push[strongest] * ray_y[strongest]
