"""Worlds as arrays, kept for the chunks to come: most chunks of a batch drive in the worlds of the one before.

What an application gets of a world is shared by all episodes in it, so that its arrays cannot be written to.
"""

from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from specs.data.world import World
from tasks.simulate.application.contract import HostMap
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.surroundings.floor_map import floor_map
from tasks.simulate.surroundings.obstacles import Obstacles, obstacles, pad_obstacles
from tasks.simulate.surroundings.rooms import RoomMap, room_map
from tasks.simulate.surroundings.silhouettes import HostSilhouettes, pad_silhouettes, silhouettes
from tasks.simulate.surroundings.ways.shortest_path import Ways

_SEEN_M = 1e-3  # half the thickness of the lidar's plane
# All worlds of a chunk are kept, whatever they take, and of others what this leaves room for.
_KEPT_BYTES = 96 << 20


class Stage(NamedTuple):
    """One world as arrays: what is touched, what is seen, the map, the rooms on it, and the ways about it."""

    touched: Obstacles
    seen: HostSilhouettes
    floor: HostMap
    rooms: RoomMap
    ways: Ways


class _Kept(NamedTuple):
    """A stage without what fills it up, and its world: as long as it is kept, no other can have its identity."""

    world: World
    stage: Stage


class _Most(NamedTuple):
    """Obstacles and outlines of a world, each kind filled up to the most that worlds had until now."""

    touched: Obstacles
    seen: HostSilhouettes


_most: dict[tuple[Hull, float], _Most] = {}
_Key = tuple[int, Hull, float]
_kept: OrderedDict[_Key, _Kept] = OrderedDict()


def stage_worlds(worlds: Mapping[str, World], hull: Hull, seen_at_m: float) -> dict[str, Stage]:
    """Returns the worlds as arrays; each its own map, and obstacles filled up to the same, bucketed counts.

    What fills them up is out of reach and no application ever gets it. The counts are those of worlds before, for the
    same robot, where these have at most twice as many: a program that is loaded takes them then. No row hangs on it.

    Args:
        worlds: By name.
        hull: The robot's.
        seen_at_m: The height of its lidar's plane.
    """
    if not worlds:
        return {}
    stages = [_stage(world, hull, seen_at_m) for world in worlds.values()]
    _forget(len(stages))
    touched, seen = _filled(stages, (hull, seen_at_m))
    filled = [stage._replace(touched=one, seen=other) for stage, one, other in zip(stages, touched, seen, strict=True)]
    return dict(zip(worlds, filled, strict=True))


def _filled(stages: Sequence[Stage], robot: tuple[Hull, float]) -> tuple[list[Obstacles], list[HostSilhouettes]]:
    touched, seen = pad_obstacles(stage.touched for stage in stages), pad_silhouettes(stage.seen for stage in stages)
    most = _most.get(robot)
    if most is not None and _at_most_twice(most.touched, touched[0]) and _at_most_twice(most.seen, seen[0]):
        touched, seen = pad_obstacles([most.touched, *touched])[1:], pad_silhouettes([most.seen, *seen])[1:]
    most = most or _Most(touched[0], seen[0])
    larger = _larger(most.seen[:3], seen[0][:3])
    _most[robot] = _Most(
        Obstacles(*_larger(most.touched, touched[0])), HostSilhouettes(*larger, counts=most.seen.counts)
    )
    return touched, seen


def _at_most_twice(some: Iterable[np.ndarray], others: Iterable[np.ndarray]) -> bool:
    return all(len(one) <= 2 * len(other) for one, other in zip(some, others, strict=True))


def _larger(some: Iterable[np.ndarray], others: Iterable[np.ndarray]) -> list[np.ndarray]:
    return [max(pair, key=len) for pair in zip(some, others, strict=True)]


def _stage(world: World, hull: Hull, seen_at_m: float) -> Stage:
    key = (id(world), hull, seen_at_m)
    kept = _kept.pop(key, None) or _Kept(world, _new_stage(world, hull, seen_at_m))
    _kept[key] = kept
    return kept.stage


def _new_stage(world: World, hull: Hull, seen_at_m: float) -> Stage:
    touched = obstacles(world, hull.low_m, hull.high_m)
    seen = silhouettes(obstacles(world, seen_at_m - _SEEN_M, seen_at_m + _SEEN_M))
    floor = floor_map(world, touched)
    for array in floor:
        array.setflags(write=False)
    return Stage(touched, seen, floor, room_map(world.rooms, floor, hull.radius_m), Ways(touched, hull.radius_m))


def _forget(used: int) -> None:
    """Forgets the stages that were used longest ago, except so many, until the rest takes no more than it may."""
    most = sum(_bytes(kept.stage) for kept in _kept.values())
    while most > _KEPT_BYTES and len(_kept) > used:
        _, gone = _kept.popitem(last=False)
        most -= _bytes(gone.stage)


def _bytes(stage: Stage) -> int:
    """Returns what a stage takes: its maps, and about as much as the ways on them."""
    return 2 * (stage.floor.clearance_m.nbytes + stage.rooms.parts.nbytes)
