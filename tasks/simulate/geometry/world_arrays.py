"""Worlds as arrays, kept for the chunks to come: most chunks of a batch drive in the worlds of the one before.

What an application gets of a world is shared by all episodes in it, so that its arrays cannot be written to. The map
that a robot plans on holds the clearance to the nearest solid, on a grid whose size follows from the world alone.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64

from specs.data.world import World
from tasks.simulate.application.contract import HostMap
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.depth_picture import DepthScene, depth_scene, pad_scenes
from tasks.simulate.geometry.hull_outline import inner_distance_m
from tasks.simulate.geometry.lidar_scan import HostLidarOutlines, lidar_outlines, pad_lidar_outlines
from tasks.simulate.geometry.obstacles import CELL_M, Obstacles, extent_m, grid_cells, obstacles, pad_obstacles
from tasks.simulate.geometry.rooms import RoomMap, room_map
from tasks.simulate.geometry.shortest_path import Ways

# The radius of a disc that every robot has room for on its axis. A narrower one would slip through the seams of walls.
_NARROWEST_M = 0.01


def floor_map(world: World, obstacles: Obstacles) -> HostMap:
    """Returns the clearance map of a world, centred on it.

    Its size follows from the world alone and never from other worlds: applications may look at it
    (docs/decisions/0019-arrays-of-ones-own.md).

    Args:
        world: Gives the outer faces; outside them the clearance is 0. Where the largest grid does not cover them at
            10 cm, cells grow.
        obstacles: The solids in the robot's band of heights.
    """
    cells, outer = grid_cells(world), world.footprint
    bounds = np.array([outer.x_min_m, outer.y_min_m, outer.x_max_m, outer.y_max_m])
    cell_m = max(CELL_M, extent_m(world) / cells)
    origin = (bounds[:2] + bounds[2:]) / 2 - cell_m * (cells - 1) / 2
    x, y = (origin[axis] + cell_m * np.arange(cells) for axis in (0, 1))
    columns, rows = (x >= bounds[0]) & (x <= bounds[2]), (y >= bounds[1]) & (y <= bounds[3])
    clearance = np.zeros((cells, cells), np.float32)
    clearance[np.ix_(rows, columns)] = np.maximum(_distance(x[columns], y[rows], obstacles), 0.0)
    return HostMap(clearance, origin.astype(np.float32), np.asarray(cell_m, np.float32), bounds.astype(np.float32))


def _distance(
    x: Float64[np.ndarray, "columns"], y: Float64[np.ndarray, "rows"], obstacles: Obstacles
) -> Float64[np.ndarray, "rows columns"]:
    """Returns the distance to the nearest obstacle, seen from above; 0 or less inside one."""
    squared = np.full((len(y), len(x)), np.inf)
    for box in obstacles.boxes.astype(np.float64):
        np.minimum(squared, _to_box_squared(x, y, box), out=squared)
    nearest = np.sqrt(squared)
    for cylinder in obstacles.cylinders.astype(np.float64):
        away = np.sqrt((x - cylinder[0]) ** 2 + ((y - cylinder[1]) ** 2)[:, None]) - cylinder[3]
        np.minimum(nearest, away, out=nearest)
    for prism in obstacles.prisms.astype(np.float64):
        _keep_to_prism(nearest, x - prism[0], y - prism[1], prism[4:].reshape(-1, 2))
    return nearest


def _keep_to_prism(
    nearest: Float64[np.ndarray, "rows columns"],
    x: Float64[np.ndarray, "columns"],
    y: Float64[np.ndarray, "rows"],
    corners: Float64[np.ndarray, "corners 2"],
) -> None:
    """Lowers distances to those from a prism's outline where it may be nearer: the circle around it is."""
    away = np.sqrt(x**2 + (y**2)[:, None]) - np.hypot(*corners.T).max()
    row, column = np.nonzero(away < nearest)
    to_prism = np.maximum(inner_distance_m(corners, np.stack([x[column], y[row]], axis=1)), 0.0)
    nearest[row, column] = np.minimum(nearest[row, column], to_prism)


def _to_box_squared(
    x: Float64[np.ndarray, "columns"], y: Float64[np.ndarray, "rows"], box: Float64[np.ndarray, "8"]
) -> Float64[np.ndarray, "rows columns"]:
    dx, dy, (half_x, half_y), (cos, sin) = x - box[0], (y - box[1])[:, None], box[3:5], box[6:8]
    # Most boxes stand upright: how far a cell is beyond their faces is known by its row and column alone.
    along, across = (dx, dy) if sin == 0.0 else (cos * dx + sin * dy, cos * dy - sin * dx)
    return np.maximum(np.abs(along) - half_x, 0.0) ** 2 + np.maximum(np.abs(across) - half_y, 0.0) ** 2


_PLANE_M = 1e-3  # half the thickness of the lidar's plane
# All worlds of a chunk are kept, whatever they take, and of others what this leaves room for.
_KEPT_BYTES = 96 << 20


class WorldArrays(NamedTuple):
    """One world as arrays: what a hull can touch, what a lidar can see, the map, the rooms on it, and the ways.

    Attributes:
        ways: Of a disc as wide as the robot.
        narrow_ways: Of one that no robot is narrower than.
        scene: What a depth camera can see; None for a robot without.
    """

    contact_obstacles: Obstacles
    lidar_outlines: HostLidarOutlines
    floor: HostMap
    rooms: RoomMap
    ways: Ways
    narrow_ways: Ways
    scene: DepthScene | None = None


class _Kept(NamedTuple):
    """Arrays of a world without what fills them up, and it: as long as it is kept, no other can have its identity."""

    world: World
    arrays: WorldArrays


# What is filled up to the same counts: of a world, and the most that worlds had until now.
_Parts = dict[str, Any]
_PAD: Mapping[str, Callable[[Iterable[Any]], list[Any]]] = {
    "contact_obstacles": pad_obstacles,
    "lidar_outlines": pad_lidar_outlines,
    "scene": pad_scenes,
}
# The hull, the lidar's height, and, of each part that there is, whether it has prisms.
_Filling = tuple[Hull, float, tuple[bool, ...]]
_most: dict[_Filling, _Parts] = {}
_Key = tuple[int, Hull, float, bool]
_kept: OrderedDict[_Key, _Kept] = OrderedDict()


def arrays_of_worlds(
    worlds: Mapping[str, World], hull: Hull, lidar_m: float, *, scenes: bool = False
) -> dict[str, WorldArrays]:
    """Returns the worlds as arrays; each its own map, and obstacles filled up to the same, bucketed counts.

    What fills them up is out of reach and no application ever gets it. The counts are those of worlds before, for the
    same robot, where these have at most twice as many: a program that is loaded takes them then. No row hangs on it.
    Worlds without prisms get no places for them, whatever other worlds have.

    Args:
        worlds: By name.
        hull: The robot's.
        lidar_m: The height of its lidar's plane.
        scenes: Whether it has a depth camera.
    """
    if not worlds:
        return {}
    unfilled = {name: _arrays_of(world, hull, lidar_m, scenes) for name, world in worlds.items()}
    _forget(len(unfilled))
    alike: dict[_Filling, list[str]] = {}
    for name, arrays in unfilled.items():
        prisms = tuple(len(part.prisms) > 0 for part in _parts(arrays).values())
        alike.setdefault((hull, lidar_m, prisms), []).append(name)
    filled: dict[str, WorldArrays] = {}
    for filling, names in alike.items():
        filled.update(zip(names, _filled([unfilled[name] for name in names], filling), strict=True))
    return {name: filled[name] for name in worlds}


def _parts(arrays: WorldArrays) -> _Parts:
    return {name: part for name in _PAD if (part := getattr(arrays, name)) is not None}


def _filled(worlds_arrays: Sequence[WorldArrays], filling: _Filling) -> list[WorldArrays]:
    own = [_parts(arrays) for arrays in worlds_arrays]
    parts = {name: _PAD[name](each[name] for each in own) for name in own[0]}
    most = _most.get(filling) or {name: each[0] for name, each in parts.items()}
    if all(_at_most_twice(most[name], each[0]) for name, each in parts.items()):
        parts = {name: _PAD[name]([most[name], *each])[1:] for name, each in parts.items()}
    _most[filling] = {name: _larger(most[name], each[0]) for name, each in parts.items()}
    each_world = zip(*parts.values(), strict=True)
    return [
        arrays._replace(**dict(zip(parts, filled, strict=True)))
        for arrays, filled in zip(worlds_arrays, each_world, strict=True)
    ]


def _at_most_twice(some: Iterable[np.ndarray], others: Iterable[np.ndarray]) -> bool:
    return all(len(one) <= 2 * len(other) for one, other in zip(some, others, strict=True))


def _larger(some: Any, others: Any) -> Any:  # noqa: ANN401 - a part, of arrays
    """Returns a part of a world, each array of it the longer one of two."""
    return type(some)(*(max(pair, key=len) for pair in zip(some, others, strict=True)))


def _arrays_of(world: World, hull: Hull, lidar_m: float, scenes: bool) -> WorldArrays:  # noqa: FBT001 - a part of a key
    key = (id(world), hull, lidar_m, scenes)
    kept = _kept.pop(key, None) or _Kept(world, _new_arrays(world, hull, lidar_m))
    if scenes and kept.arrays.scene is None:
        kept = kept._replace(arrays=kept.arrays._replace(scene=depth_scene(world)))
    _kept[key] = kept
    return kept.arrays


def _new_arrays(world: World, hull: Hull, lidar_m: float) -> WorldArrays:
    contacts = obstacles(world, hull.low_m, hull.high_m)
    outlines = lidar_outlines(obstacles(world, lidar_m - _PLANE_M, lidar_m + _PLANE_M))
    floor = floor_map(world, contacts)
    for array in floor:
        array.setflags(write=False)
    rooms = room_map(world.areas, floor, hull.radius_m)
    ways, narrow = (Ways(contacts, radius_m) for radius_m in (hull.radius_m, _NARROWEST_M))
    return WorldArrays(contacts, outlines, floor, rooms, ways, narrow)


def _forget(used: int) -> None:
    """Forgets the worlds that were used longest ago, except so many, until the rest takes no more than it may."""
    most = sum(_bytes(kept.arrays) for kept in _kept.values())
    while most > _KEPT_BYTES and len(_kept) > used:
        _, gone = _kept.popitem(last=False)
        most -= _bytes(gone.arrays)


def _bytes(arrays: WorldArrays) -> int:
    """Returns what a world's arrays take: its maps, and about as much as the ways on them."""
    return 2 * (arrays.floor.clearance_m.nbytes + arrays.rooms.parts.nbytes)
