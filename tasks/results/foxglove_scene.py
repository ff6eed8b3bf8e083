"""A world, its goals and the robot as entities of a Foxglove scene."""

import math
from collections.abc import Sequence
from typing import cast

from pydantic import JsonValue

from specs.world import Color, Solid, World
from tasks.results.playback import Playback

WORLD_FRAME, ROBOT_FRAME, LIDAR_FRAME = "world", "robot", "lidar"
Message = dict[str, JsonValue]
_ROBOT, _NOSE = (0.98, 0.67, 0.0), (0.13, 0.13, 0.14)
_GOAL, _WAY = (0.09, 0.5, 0.22), (0.69, 0.38, 0.0)
_GOAL_M, _THIN_M, _GROUND_M = 0.1, 0.01, 0.005
_KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
_LINE_STRIP = 0


def time_of(time_s: float) -> Message:
    """Returns a time as Foxglove has it: seconds and nanoseconds."""
    nanoseconds = nanoseconds_of(time_s)
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def nanoseconds_of(time_s: float) -> int:
    """Returns a time in whole nanoseconds, those of a microsecond."""
    return round(time_s * 1e6) * 1000


def vector(x: float, y: float, z: float) -> Message:
    """Returns a point or a size."""
    return {"x": float(x), "y": float(y), "z": float(z)}


def turn(yaw_rad: float) -> Message:
    """Returns a turn about z as a quaternion."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def pose(x: float, y: float, z: float = 0.0, yaw_rad: float = 0.0) -> Message:
    """Returns a pose upright above the floor."""
    return {"position": vector(x, y, z), "orientation": turn(yaw_rad)}


def scene(world: World, playback: Playback) -> Message:
    """Returns the scene: floors, each solid, the goals, the whole way, and the robot, which moves with its frame."""
    entities = [_floors(world), *_furnished(world), _goals(playback), _way(playback), _robot(playback)]
    return {"deletions": [], "entities": cast("JsonValue", entities)}


def _entity(name: str, frame: str = WORLD_FRAME, **primitives: Sequence[Message]) -> Message:
    filled: Message = {kind: cast("JsonValue", [*primitives.get(kind, ())]) for kind in _KINDS}
    return {
        "timestamp": time_of(0.0),
        "frame_id": frame,
        "id": name,
        "lifetime": time_of(0.0),
        "frame_locked": True,
        "metadata": [],
        **filled,
    }


def _furnished(world: World) -> list[Message]:
    """Returns an entity for the walls and one for each piece, so that each can be hidden by itself."""
    walls = (*world.walls, *(door.leaf for door in world.doors))
    named = [("walls", walls), *((piece.name, piece.solids) for piece in world.furniture)]
    return [
        _entity(
            name,
            cubes=[_solid(each) for each in parts if each.shape == "box"],
            cylinders=[_solid(each) for each in parts if each.shape == "cylinder"],
        )
        for name, parts in named
    ]


def _solid(solid: Solid) -> Message:
    half_x, half_y, half_z = solid.half_extents_m
    shape: Message = {
        "pose": pose(*solid.center_m, solid.yaw_rad),
        "size": vector(2 * half_x, 2 * half_y, 2 * half_z),
        "color": _color(solid.color),
    }
    return shape if solid.shape == "box" else {**shape, "bottom_scale": 1.0, "top_scale": 1.0}


def _floors(world: World) -> Message:
    cubes: list[Message] = []
    for room in world.rooms:
        area = room.floor
        center = ((area.x_min_m + area.x_max_m) / 2, (area.y_min_m + area.y_max_m) / 2)
        size = vector(area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m, _THIN_M)
        cubes.append({"pose": pose(*center, -_GROUND_M), "size": size, "color": _color(room.flooring.color)})
    return _entity("floors", cubes=cubes)


def _goals(playback: Playback) -> Message:
    across = 2 * (playback.arrived_m or _GOAL_M)
    spots: list[Message] = [
        {
            "pose": pose(x, y, _THIN_M),
            "size": vector(across, across, _THIN_M),
            "bottom_scale": 1.0,
            "top_scale": 1.0,
            "color": _color(_GOAL, 0.5),
        }
        for x, y in playback.goals_m.tolist()
    ]
    return _entity("goals", cylinders=spots)


def _way(playback: Playback) -> Message:
    line: Message = {
        "type": _LINE_STRIP,
        "pose": pose(0.0, 0.0, 2 * _THIN_M),
        "thickness": 2 * _THIN_M,
        "scale_invariant": False,
        "points": cast("JsonValue", [vector(x, y, 0.0) for x, y in playback.pose[:, :2].tolist()]),
        "color": _color(_WAY, 0.7),
        "colors": [],
        "indices": [],
    }
    return _entity("way", lines=[line])


def _robot(playback: Playback) -> Message:
    (low, high), across = playback.heights_m, 2 * playback.radius_m
    hull: Message = {
        "pose": pose(0.0, 0.0, (low + high) / 2),
        "size": vector(across, across, high - low),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": _color(_ROBOT),
    }
    nose: Message = {
        "pose": pose(0.0, 0.0, high + _THIN_M),
        "shaft_length": 0.6 * playback.radius_m,
        "shaft_diameter": 0.1 * playback.radius_m,
        "head_length": 0.4 * playback.radius_m,
        "head_diameter": 0.3 * playback.radius_m,
        "color": _color(_NOSE),
    }
    return _entity("robot", ROBOT_FRAME, cylinders=[hull], arrows=[nose])


def _color(color: Color, alpha: float = 1.0) -> Message:
    red, green, blue = color
    return {"r": red, "g": green, "b": blue, "a": alpha}
