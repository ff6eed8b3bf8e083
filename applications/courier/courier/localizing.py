"""Where the robot is, from what its wheels count and where its scan fits the map.

The ends of its rays lie on solids, where the map's clearance is 0: at each control step the pose is moved a little down
the clearances that they have instead (a likelihood field, Thrun, Burgard and Fox, Probabilistic Robotics 2005, section
6.4; one step of Gauss and Newton's). The correction is kept, so that counting goes on from it.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

if TYPE_CHECKING:
    from tasks.simulate.application.contract import FloorMap

# An end this far from any solid counts half: it may be the ray's error, or something that the map does not have.
_HALF_M = 0.1
# What the counted pose weighs against the rays: keeps still whatever they say nothing about, such as a long wall.
_TRUST = 0.5
_GAIN = 0.3
Pose = Float[jax.Array, "3"]
Rays = Float[jax.Array, "rays"]


class Belief(NamedTuple):
    """The map, and what takes the counted pose to the corrected one: a turn about the origin, then a shift."""

    floor: "FloorMap"
    shift_m: Float[jax.Array, "2"]
    turn_rad: Float[jax.Array, ""]


def belief_at_start(floor: "FloorMap") -> Belief:
    """Returns the belief that the wheels count right."""
    return Belief(floor, jnp.zeros(2), jnp.zeros(()))


def corrected(belief: Belief, counted: Pose) -> Pose:
    """Returns the pose (x m, y m, yaw rad) that is believed in when the wheels count another."""
    place = _turned(counted[:2], belief.turn_rad) + belief.shift_m
    return jnp.concatenate([place, (counted[2] + belief.turn_rad)[None]])


def matched(belief: Belief, counted: Pose, ranges_m: Rays, angles_rad: Rays, range_m: float) -> Belief:
    """Returns the belief after a scan.

    Args:
        belief: That before it.
        counted: The pose that the wheels count.
        ranges_m: The scan; a ray that reports ``range_m`` saw nothing, or was lost.
        angles_rad: The rays' directions in the robot's frame.
        range_m: The lidar's range.
    """
    pose = corrected(belief, counted)
    bearing = pose[2] + angles_rad
    arm_x, arm_y = ranges_m * jnp.cos(bearing), ranges_m * jnp.sin(bearing)
    off_m, slope_x, slope_y = _clearance_at(belief.floor, pose[0] + arm_x, pose[1] + arm_y)
    weight = jnp.where(ranges_m < range_m, 1.0 / (1.0 + (off_m / _HALF_M) ** 2) ** 2, 0.0)
    lever = slope_y * arm_x - slope_x * arm_y
    slopes = jnp.stack([slope_x, slope_y, lever])
    normal = (slopes * weight) @ slopes.T + _TRUST * jnp.eye(3)
    step = -_GAIN * _solved(normal, slopes @ (weight * off_m))
    turn = belief.turn_rad + step[2]
    return Belief(belief.floor, pose[:2] + step[:2] - _turned(counted[:2], turn), turn)


def _clearance_at(floor: "FloorMap", x_m: Rays, y_m: Rays) -> tuple[Rays, Rays, Rays]:
    """Returns the clearance between four cells' centres, and how it rises along x and y."""
    rows, columns = floor.clearance_m.shape
    across = jnp.clip((x_m - floor.origin_m[0]) / floor.cell_m, 0.0, columns - 1.001)
    along = jnp.clip((y_m - floor.origin_m[1]) / floor.cell_m, 0.0, rows - 1.001)
    column, row = across.astype(jnp.int32), along.astype(jnp.int32)
    u, v = across - column, along - row
    low, high = _pair(floor, row, column), _pair(floor, row + 1, column)
    clearance_m = (1 - v) * ((1 - u) * low[0] + u * low[1]) + v * ((1 - u) * high[0] + u * high[1])
    slope_x = ((1 - v) * (low[1] - low[0]) + v * (high[1] - high[0])) / floor.cell_m
    slope_y = ((1 - u) * (high[0] - low[0]) + u * (high[1] - low[1])) / floor.cell_m
    return clearance_m, slope_x, slope_y


def _pair(floor: "FloorMap", row: jax.Array, column: jax.Array) -> tuple[jax.Array, jax.Array]:
    return floor.clearance_m[row, column], floor.clearance_m[row, column + 1]


def _solved(matrix: Float[jax.Array, "3 3"], right: Float[jax.Array, "3"]) -> Float[jax.Array, "3"]:
    """Returns the solution of three equations, by Cramer's rule: the same bits in any batch."""
    columns = (
        jnp.cross(matrix[1], matrix[2]),
        jnp.cross(matrix[2], matrix[0]),
        jnp.cross(matrix[0], matrix[1]),
    )
    return (jnp.stack(columns, axis=1) @ right) / jnp.dot(matrix[0], columns[0])


def _turned(vector: Float[jax.Array, "2"], angle_rad: Float[jax.Array, ""]) -> Float[jax.Array, "2"]:
    cos, sin = jnp.cos(angle_rad), jnp.sin(angle_rad)
    return jnp.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
