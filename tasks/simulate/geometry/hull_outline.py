"""The parts of a robot's hull as they are seen from above: convex outlines, each in its band of heights."""

from pathlib import Path
from typing import Any, NamedTuple, get_args

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.robot_shape import PartKind, RobotPart
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import base_of, compile_robot, resting

# An outline has at most so many corners; of a rounder one, the points farthest out in as many directions are taken.
_MOST_CORNERS = 32
_RIM_POINTS = 64
_ROUND_RAD = 2 * np.pi * np.arange(32) / 32
_ROD = 2  # as many corners as an outline without an inside has at most
# Corners nearer than this to the line between their neighbours, and ends nearer to each other, are none.
_SPECK_M = 1e-6
# What leans less stands upright (half a degree).
_UPRIGHT = 0.99996
_ROUND = (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
Points = Float64[np.ndarray, "points 2"]
Corners = Float64[np.ndarray, "corners 2"]


class HullPart(NamedTuple):
    """A geom, seen from above: all points within a radius of a convex outline.

    Attributes:
        corners: Of the outline in the base's frame, counter-clockwise; one for a disc, two for a rod.
        low_m, high_m: Its band of heights; without limits for a robot whose parts rise, sink or tilt.
    """

    corners: Corners
    radius_m: float
    low_m: float
    high_m: float


def hull_parts(model: mujoco.MjModel) -> tuple[HullPart, ...]:
    """Returns the outlines of what collides of a robot as it stands at the start, those inside others left out.

    Spheres, boxes, capsules that lie or stand, and cylinders that stand are exact; the outline of what is rounder has
    its corners on the true one, and lies within a hundredth of its size.
    """
    data, base = resting(model), base_of(model)
    origin = data.xpos[base.body][:2]
    parts = [
        _part(model, data, geom, origin, rigid=not (base.free or base.articulated))
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] and (model.geom_contype[geom] or model.geom_conaffinity[geom])
    ]
    parts.sort(key=_size_m, reverse=True)
    kept: list[HullPart] = []
    for part in parts:
        if not any(_encloses(other, part) for other in kept):
            kept.append(part)
    return tuple(kept)


def robot_shape(path: Path) -> tuple[RobotPart, ...]:
    """Returns what a robot looks like as it stands at the start: each geom that is seen, the lowest first.

    Raises:
        RobotRefused: No engine takes the robot.
    """
    model = compile_robot(read_robot_mjcf(path))
    data, base = resting(model), base_of(model)
    seen = (model.geom_rgba[:, 3] > 0) & (model.body_weldid[model.geom_bodyid] != 0)
    kinds = {getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"): kind for kind in get_args(PartKind)}
    parts = [
        _seen_part(data, geom, kinds[mujoco.mjtGeom(model.geom_type[geom])], data.xpos[base.body][:2])
        for geom in np.flatnonzero(seen).tolist()
        if mujoco.mjtGeom(model.geom_type[geom]) in kinds
    ]
    return tuple(sorted(parts, key=lambda part: part.top_m))


def _seen_part(data: mujoco.MjData, geom: int, kind: PartKind, origin: Float64[np.ndarray, "2"]) -> RobotPart:
    model, turn, turned = data.model, data.geom_xmat[geom].reshape(3, 3), np.empty(4)
    mujoco.mju_mat2Quat(turned, data.geom_xmat[geom])
    points, radius_m = _core(model, geom, turn)
    place = data.geom_xpos[geom] - [*origin, 0.0]
    seen = place + points @ turn.T
    round_it = radius_m * np.stack([np.cos(_ROUND_RAD), np.sin(_ROUND_RAD)], axis=1) if radius_m else np.zeros((1, 2))
    outline = _convex((seen[:, None, :2] + round_it).reshape(-1, 2))
    return RobotPart(
        kind=kind,
        size=_numbers(model.geom_size[geom]),
        position_m=_numbers(place),
        turn=_numbers(turned),
        color=_numbers(model.geom_rgba[geom]),
        outline_m=tuple(_numbers(corner) for corner in outline),
        top_m=float(seen[:, 2].max() + radius_m),
        vertices_m=tuple(_numbers(point) for point in points) if kind == "mesh" else (),
    )


def _numbers(values: np.ndarray) -> Any:  # noqa: ANN401 - a tuple of as many as the record has
    return tuple(float(value) for value in values)


def inner_distance_m(corners: Corners, points: Points) -> Float64[np.ndarray, "points"]:
    """Returns how far points are from a convex outline: exactly outside one, minus the depth inside."""
    ends = np.roll(corners, -1, axis=0)
    along, from_corner = ends - corners, points[:, None] - corners
    share = np.clip((from_corner * along).sum(-1) / np.maximum((along**2).sum(-1), _SPECK_M**2), 0.0, 1.0)
    to_edges = np.linalg.norm(from_corner - share[..., None] * along, axis=-1).min(axis=1)
    if len(corners) <= _ROD:
        return to_edges
    left = (along[:, 0] * from_corner[..., 1] - along[:, 1] * from_corner[..., 0]).min(axis=1)
    return np.where(left >= 0.0, -to_edges, to_edges)


def _part(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, origin: Float64[np.ndarray, "2"], *, rigid: bool
) -> HullPart:
    center, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    points, radius_m = _core(model, geom, turn)
    seen = center + points @ turn.T
    low_m, high_m = float(seen[:, 2].min() - radius_m), float(seen[:, 2].max() + radius_m)
    if mujoco.mjtGeom(model.geom_type[geom]) in _ROUND and abs(turn[2, 2]) > _UPRIGHT:
        corners, radius_m = center[None, :2], float(model.geom_size[geom][0])
    else:
        corners = _convex(seen[:, :2])
    return HullPart(corners - origin, radius_m, *((low_m, high_m) if rigid else (-np.inf, np.inf)))


def _core(
    model: mujoco.MjModel, geom: int, turn: Float64[np.ndarray, "3 3"]
) -> tuple[Float64[np.ndarray, "points 3"], float]:
    """Returns points in a geom's own frame, and the radius of the balls around them whose hull is the geom."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]]), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle), np.zeros(_RIM_POINTS)], axis=1)
        up = np.array([0.0, 0.0, size[1]])
        return np.concatenate([rim + up, rim - up]), 0.0
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return _ellipsoid_rim(size, turn), 0.0
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], float), 0.0
    middle, half_extents = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    return middle + np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * half_extents, 0.0


def _ellipsoid_rim(
    half_axes: Float64[np.ndarray, "3"], turn: Float64[np.ndarray, "3 3"]
) -> Float64[np.ndarray, "points 3"]:
    """Returns the points of an ellipsoid that are farthest out to all sides, its top and its bottom, in its frame."""
    angle = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    level = np.stack([np.cos(angle), np.sin(angle), np.zeros(_RIM_POINTS)], axis=1)
    outward = np.concatenate([level, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) @ turn
    stretched = outward * half_axes**2
    return stretched / np.linalg.norm(outward * half_axes, axis=1, keepdims=True)


def _convex(points: Points) -> Corners:
    """Returns the corners of points' convex hull, counter-clockwise; one or two if they lie in a point or a line."""
    outer = _farthest_out(points, 2 * _RIM_POINTS) if len(points) > 2 * _RIM_POINTS + 2 else points  # of a mesh
    ordered = outer[np.lexsort((outer[:, 1], outer[:, 0]))]
    corners = np.array([*_chain(ordered)[:-1], *_chain(ordered[::-1])[:-1]]).reshape(-1, 2)
    if len(corners) == 0 or np.ptp(points, axis=0).max() < _SPECK_M:
        return points.mean(axis=0)[None]
    return _farthest_out(corners, _MOST_CORNERS) if len(corners) > _MOST_CORNERS else corners


def _chain(ordered: Points) -> list[Float64[np.ndarray, "2"]]:
    """Returns the right-hand side of points' convex hull, from the first to the last (Andrew's monotone chain)."""
    chain: list[np.ndarray] = []
    for point in ordered:
        while len(chain) > 1 and _turns_right(chain[-2], chain[-1], point):
            chain.pop()
        chain.append(point)
    return chain


def _turns_right(
    first: Float64[np.ndarray, "2"], second: Float64[np.ndarray, "2"], third: Float64[np.ndarray, "2"]
) -> bool:
    (x, y), (to_x, to_y) = second - first, third - first
    return bool(x * to_y - y * to_x <= _SPECK_M * np.hypot(to_x, to_y))


def _farthest_out(points: Points, count: int) -> Corners:
    angle = 2 * np.pi * np.arange(count) / count
    chosen = np.argmax(np.stack([np.cos(angle), np.sin(angle)], axis=1) @ points.T, axis=1)
    return points[list(dict.fromkeys(chosen.tolist()))]


def _size_m(part: HullPart) -> float:
    return float(np.hypot(*np.ptp(part.corners, axis=0))) + 2 * part.radius_m


def _encloses(outer: HullPart, inner: HullPart) -> bool:
    if inner.low_m < outer.low_m or inner.high_m > outer.high_m:
        return False
    reach_m = inner_distance_m(outer.corners, inner.corners) + inner.radius_m
    return bool((reach_m <= outer.radius_m + _SPECK_M).all())
