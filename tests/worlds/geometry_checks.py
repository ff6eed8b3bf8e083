"""Checks of a finished world that share no code with the generator: exact distances, separating axes, a flood fill."""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from specs.data.world import Door, Furniture, Solid, World, solids

HEAD_M = 2.0
_ROUNDING_M = 1e-5
_STEP_M = 0.04


def bottom_m(solid: Solid) -> float:
    """Returns the height at which a solid begins."""
    return solid.center_m[2] - solid.half_extents_m[2]


def top_m(solid: Solid) -> float:
    """Returns the height at which a solid ends."""
    return solid.center_m[2] + solid.half_extents_m[2]


def distances(solid: Solid, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, " points"]:
    """Returns the distance on the floor from each point to a solid; 0 inside."""
    offset = points - np.array(solid.center_m[:2])
    if solid.shape == "cylinder":
        return np.maximum(np.hypot(offset[:, 0], offset[:, 1]) - solid.half_extents_m[0], 0.0)
    if solid.shape == "prism":
        return _to_polygon(polygon(solid), points)
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    local = np.abs(np.stack([cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]], axis=1))
    beyond = np.maximum(local - np.array(solid.half_extents_m[:2]), 0.0)
    return np.hypot(beyond[:, 0], beyond[:, 1])


def _to_polygon(corners: Float[np.ndarray, "corners 2"], points: Float[np.ndarray, "points 2"]) -> np.ndarray:
    """Returns how far points are from a polygon's edges; 0 where a ray along x crosses an odd number of them."""
    point, begin = points @ [1.0, 1.0j], corners @ [1.0, 1.0j]
    nearest, odd = np.full(len(points), np.inf), np.zeros(len(points), dtype=bool)
    for one, other in zip(begin, np.roll(begin, -1), strict=True):
        seen = (point - one) / (other - one)  # the edge as the way from 0 to 1
        nearest = np.minimum(nearest, np.abs(seen - np.clip(seen.real, 0.0, 1.0)) * abs(other - one))
        between = (one.imag > point.imag) != (other.imag > point.imag)
        odd ^= between & ((seen.imag > 0.0) == (other.imag > one.imag))
    return np.where(odd, 0.0, nearest)


def in_the_way(world: World) -> list[Solid]:
    """Returns the solids that begin below head height."""
    return [solid for solid in solids(world) if bottom_m(solid) < HEAD_M]


def distance_to_start(world: World) -> float:
    """Returns the distance from (0, 0) to the nearest solid in the way."""
    origin = np.zeros((1, 2))
    return min(float(distances(solid, origin)[0]) for solid in in_the_way(world))


def polygon(solid: Solid) -> Float[np.ndarray, "corners 2"]:
    """Returns a solid's outline; a cylinder as an inscribed polygon of 32 corners."""
    half_x, half_y, _ = solid.half_extents_m
    if solid.shape == "cylinder":
        angles = np.linspace(0.0, 2 * math.pi, 32, endpoint=False)
        return np.array(solid.center_m[:2]) + half_x * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    square = ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
    corners = np.array(solid.outline_m or square)
    return corners @ np.array([[cos, sin], [-sin, cos]]) + np.array(solid.center_m[:2])


def intersect(first: Solid, second: Solid) -> bool:
    """Returns whether two solids share more than a surface (separating axes of both outlines, and heights)."""
    if top_m(first) <= bottom_m(second) + _ROUNDING_M or top_m(second) <= bottom_m(first) + _ROUNDING_M:
        return False
    outlines = polygon(first), polygon(second)
    for outline in outlines:
        edges = np.roll(outline, -1, axis=0) - outline
        normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        a, b = (each @ normals.T for each in outlines)
        if ((a.max(0) <= b.min(0) + _ROUNDING_M) | (b.max(0) <= a.min(0) + _ROUNDING_M)).any():
            return False
    return True


def intersecting(world: World) -> list[tuple[str, str]]:
    """Returns the pieces of furniture and door leaves that intersect another, or a wall."""
    things = [(piece.name, piece.solids) for piece in world.furniture]
    things += [(door.name, (door.leaf,)) for door in world.doors]
    found = [(a[0], b[0]) for a, b in combinations(things, 2) if _any_intersect(a[1], b[1])]
    return found + [(name, "walls") for name, parts in things if _any_intersect(parts, world.walls)]


def with_doors_open(world: World) -> World:
    """Returns the world with every leaf turned about its hinge to where it is fully open."""
    doors: list[Door] = []
    for door in world.doors:
        passage = world.passages[door.passage]
        length, thickness = passage.width_m - 0.02, 0.04
        yaw = door.open_yaw_rad
        # Seen from the hinge, the leaf's thickness lies towards where the leaf was when it was shut.
        x, y = (
            door.hinge_m[0] + math.cos(yaw) * length / 2 + math.cos(door.closed_yaw_rad) * thickness / 2,
            door.hinge_m[1] + math.sin(yaw) * length / 2 + math.sin(door.closed_yaw_rad) * thickness / 2,
        )
        half = (length / 2, thickness / 2, door.leaf.half_extents_m[2])
        fields = {"center_m": (x, y, door.leaf.center_m[2]), "half_extents_m": half, "yaw_rad": yaw}
        doors.append(door.model_copy(update={"leaf": door.leaf.model_copy(update=fields)}))
    return world.model_copy(update={"doors": tuple(doors)})


def _any_intersect(first: Sequence[Solid], second: Sequence[Solid]) -> bool:
    return any(intersect(a, b) for a in first for b in second if _near(a, b))


def _near(a: Solid, b: Solid) -> bool:
    reach = math.hypot(*a.half_extents_m[:2]) + math.hypot(*b.half_extents_m[:2])
    return math.dist(a.center_m[:2], b.center_m[:2]) < reach


def unreached_rooms(world: World, radius_m: float) -> list[str]:
    """Returns the rooms into which a round robot of that radius does not get from (0, 0), by a flood fill."""
    outline = world.footprint
    x = np.arange(math.ceil(outline.x_min_m / _STEP_M), math.floor(outline.x_max_m / _STEP_M) + 1)
    y = np.arange(math.ceil(outline.y_min_m / _STEP_M), math.floor(outline.y_max_m / _STEP_M) + 1)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1) * _STEP_M
    free = np.ones(grid.shape[:2], dtype=bool)
    for solid in in_the_way(world):
        # A cell outside this box is farther than the robot's radius from the solid.
        reach = math.hypot(*solid.half_extents_m[:2]) + radius_m + _STEP_M
        near = tuple(
            slice(*np.searchsorted(cells * _STEP_M, [center - reach, center + reach]))
            for cells, center in zip((x, y), solid.center_m[:2], strict=True)
        )
        free[near] &= (distances(solid, grid[near].reshape(-1, 2)) >= radius_m).reshape(free[near].shape)
    reached = _flood(free, (int(-x[0]), int(-y[0])))
    spots = grid[reached]
    return [room.name for room in world.rooms if not _inside(room.floor.model_dump(), spots, radius_m)]


def _flood(free: Bool[np.ndarray, "x y"], start: tuple[int, int]) -> Bool[np.ndarray, "x y"]:
    if not free[start]:
        return np.zeros_like(free)
    areas, _ = ndimage.label(free)  # pyright: ignore[reportGeneralTypeIssues] - it returns a pair
    return areas == areas[start]


def _inside(floor: dict[str, float], spots: Float[np.ndarray, "spots 2"], margin_m: float) -> bool:
    low = np.array([floor["x_min_m"], floor["y_min_m"]]) + margin_m
    high = np.array([floor["x_max_m"], floor["y_max_m"]]) - margin_m
    return bool(((spots >= low) & (spots <= high)).all(axis=1).any())


def room_of(world: World, piece: Furniture) -> dict[str, float]:
    """Returns the floor of the room that a piece says it stands in."""
    return next(room.floor.model_dump() for room in world.rooms if room.name == piece.room)
