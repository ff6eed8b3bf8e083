"""The courier's controller: plans on the map, follows the plan, and keeps off what its lidar sees."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .planning import RADIUS_M, cost_to_goal, point_ahead

if TYPE_CHECKING:
    from tasks.simulate.contract import FloorMap, Observation

DEFAULT_SPEED_M_S = 0.5
_AHEAD_CELLS = 5
_TURN_GAIN = 3.0
_MOST_TURN_RAD_S = 2.5
# Solids nearer than this to the hull push the heading away.
_PUSH_M = 0.18
_PUSH_GAIN = 1.2
# Deceleration to plan on, and the gap to keep from what is straight ahead.
_BRAKE_M_S2 = 0.8
_GAP_M = 0.04
_LEAST_SPEED_M_S = 0.05


class Lidar(NamedTuple):
    """A planar lidar; ``height_m`` is above the floor."""

    rays: int = 32
    range_m: float = 10.0
    height_m: float = 0.2


class Plan(NamedTuple):
    """The map, and one cost field for each goal: going on to the next goal is reading another field."""

    floor: "FloorMap"
    costs: Float[jax.Array, "goals rows columns"]


class GoToGoal:
    """Follows the cost field to the current goal at up to MAX_SPEED metres a second."""

    lidar = Lidar()

    def __init__(self, most_m_s: "float | Float[jax.Array, '']") -> None:
        self._most_m_s = most_m_s

    def init(self, floor: "FloorMap", goals_m: Float[jax.Array, "goals 2"]) -> Plan:
        """Returns the plan: ways to all goals."""
        return Plan(floor, jax.vmap(lambda goal: cost_to_goal(floor, goal))(goals_m))

    def step(self, state: Plan, observation: "Observation") -> tuple[Plan, Float[jax.Array, "3"]]:
        """Returns the plan as it is, and the control (forward m/s, turn rad/s, sideways m/s)."""
        place, yaw = observation.pose[:2], observation.pose[2]
        ahead = point_ahead(state.floor, state.costs[observation.goal_index], place, _AHEAD_CELLS)
        close = jnp.sum((observation.goal_m - place) ** 2) < (_AHEAD_CELLS * state.floor.cell_m) ** 2
        target = jnp.where(close, observation.goal_m, ahead)
        heading_x, heading_y = _heading(target - place, yaw, observation.ranges_m)
        error = jnp.arctan2(heading_y, heading_x)
        turn = jnp.clip(_TURN_GAIN * error, -_MOST_TURN_RAD_S, _MOST_TURN_RAD_S)
        forward = self._speed(error, observation.ranges_m)
        return state, jnp.stack([forward, turn, jnp.zeros_like(turn)])

    def _speed(self, error: jax.Array, ranges_m: Float[jax.Array, "rays"]) -> jax.Array:
        """Returns the speed that suits the turn to make, and lets it stop before what lies ahead."""
        free_m = jnp.min(_free_ahead(ranges_m))
        stopping = jnp.sqrt(2.0 * _BRAKE_M_S2 * jnp.maximum(free_m - _GAP_M, 0.0))
        aligned = jnp.maximum(jnp.cos(error), 0.0) ** 2
        creeping = jnp.where(free_m > _GAP_M, _LEAST_SPEED_M_S * aligned, 0.0)
        return jnp.minimum(jnp.maximum(self._most_m_s * aligned, creeping), stopping)


def controller(environment: Mapping[str, "str | Float[jax.Array, '']"]) -> GoToGoal:
    """Returns the controller; MAX_SPEED is the speed limit in metres a second.

    Raises:
        ValueError: MAX_SPEED is not a number.
    """
    limit = environment.get("MAX_SPEED", DEFAULT_SPEED_M_S)
    if isinstance(limit, str):
        raise ValueError(f"MAX_SPEED: {limit!r}: must be a number of metres a second, such as 0.5")  # noqa: TRY004 - the text is the wrong value of a variable
    return GoToGoal(limit)


def _rays() -> tuple[Float[jax.Array, "rays"], Float[jax.Array, "rays"]]:
    """Returns the directions of the lidar's rays in the robot's frame."""
    angles = 2 * np.pi * np.arange(Lidar().rays) / Lidar().rays
    return jnp.asarray(np.cos(angles), jnp.float32), jnp.asarray(np.sin(angles), jnp.float32)


def _heading(
    way_m: Float[jax.Array, "2"], yaw: Float[jax.Array, ""], ranges_m: Float[jax.Array, "rays"]
) -> tuple[jax.Array, jax.Array]:
    """Returns where to go in the robot's frame: towards the target, pushed off by near solids."""
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    length = jnp.sqrt(jnp.sum(way_m**2)) + 1e-6
    to_x, to_y = (cos * way_m[0] + sin * way_m[1]) / length, (cos * way_m[1] - sin * way_m[0]) / length
    ray_x, ray_y = _rays()
    push = _PUSH_GAIN * jnp.maximum(1.0 - jnp.maximum(ranges_m - RADIUS_M, 0.0) / _PUSH_M, 0.0) ** 2
    strongest = jnp.argmax(push)
    return to_x - push[strongest] * ray_x[strongest], to_y - push[strongest] * ray_y[strongest]


def _free_ahead(ranges_m: Float[jax.Array, "rays"]) -> Float[jax.Array, "rays"]:
    """Returns how far the hull can go straight on before it touches each ray's end; far for rays that it passes."""
    ray_x, ray_y = _rays()
    along, across = ranges_m * ray_x, ranges_m * ray_y
    reach = jnp.sqrt(jnp.maximum(RADIUS_M**2 - across**2, 0.0))
    in_way = (along > 0.0) & (jnp.abs(across) < RADIUS_M)
    return jnp.where(in_way, along - reach, Lidar().range_m)
