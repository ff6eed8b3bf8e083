"""Writes an episode as an MCAP file that Foxglove opens: frames, poses, scans, the scene, and the controls.

Foxglove knows a schema by its name (docs.foxglove.dev, message schemas); other readers read the JSON schema, which has
the fields that are written here. Times are simulated ones from 0. Needs the extra ``mcap``.
"""

import base64
import heapq
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import cast

import numpy as np
from mcap.writer import CompressionType, Writer
from pydantic import JsonValue
from scipy.spatial import ConvexHull

from specs.data.mover_colors import BOX, NOSE, OTHER, PERSON, ROBOT
from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from specs.data.robot_shape import RobotPart
from specs.data.world import Color, Solid, World, corners_m
from tasks.results.playback.playback import BoxFilm, CameraFilm, Playback
from tasks.ros.message.camera_messages import depths_in_mm, jpeg_bytes, optical_turn

WORLD_FRAME, ROBOT_FRAME, LIDAR_FRAME = "world", "robot", "lidar"
_CAMERA_FRAMES = {"depth": "camera", "color": "color-camera"}
Message = dict[str, JsonValue]
_GOAL, _WAY, _ZONE = (0.09, 0.5, 0.22), (0.69, 0.38, 0.0), (0.37, 0.41, 0.44)
_GOAL_M, _THIN_M, _GROUND_M = 0.1, 0.01, 0.005
_STRAIGHT: Message = {"bottom_scale": 1.0, "top_scale": 1.0}
_KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
_DRAWN = (("box", "cubes"), ("cylinder", "cylinders"), ("prism", "triangles"))
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


def quaternion(yaw_rad: float) -> Message:
    """Returns a turn about z as a quaternion."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def pose(x: float, y: float, z: float = 0.0, yaw_rad: float = 0.0) -> Message:
    """Returns a pose upright above the floor.

    Args:
        x: Position, m.
        y: Position, m.
        z: Height, m.
        yaw_rad: Heading, counter-clockwise from +x.
    """
    return {"position": vector(x, y, z), "orientation": quaternion(yaw_rad)}


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
    return [_entity(name, WORLD_FRAME, **_shapes(parts)) for name, parts in named]


def _shapes(solids: Sequence[Solid]) -> dict[str, list[Message]]:
    return {kind: [_solid(each) for each in solids if each.shape == shape] for shape, kind in _DRAWN}


def _solid(solid: Solid) -> Message:
    half_x, half_y, half_z = solid.half_extents_m
    if solid.shape == "prism":
        ends = (solid.center_m[2] - half_z, solid.center_m[2] + half_z)
        return _hull([(x, y, z) for x, y in corners_m(solid) for z in ends], pose(0.0, 0.0), _color(solid.color))
    shape: Message = {
        "pose": pose(*solid.center_m, solid.yaw_rad),
        "size": vector(2 * half_x, 2 * half_y, 2 * half_z),
        "color": _color(solid.color),
    }
    return shape if solid.shape == "box" else {**shape, **_STRAIGHT}


def _hull(points_m: Sequence[tuple[float, float, float]], at: Message, color: Message) -> Message:
    """Returns the triangles around points, which are seen from a pose."""
    corners = cast("JsonValue", ConvexHull(np.array(points_m)).simplices.ravel().tolist())
    points = cast("JsonValue", [vector(*point) for point in points_m])
    return {"pose": at, "points": points, "color": color, "colors": [], "indices": corners}


def _floors(world: World) -> Message:
    cubes: list[Message] = []
    for room in world.rooms:
        area = room.floor
        center = ((area.x_min_m + area.x_max_m) / 2, (area.y_min_m + area.y_max_m) / 2)
        size = vector(area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m, _THIN_M)
        cubes.append({"pose": pose(*center, -_GROUND_M), "size": size, "color": _color(room.flooring.color)})
    outlines = [_strip([*zone.outline_m, zone.outline_m[0]], _color(_ZONE)) for zone in world.zones or ()]
    return _entity("floors", cubes=cubes, lines=outlines)


def _goals(playback: Playback) -> Message:
    across = 2 * (playback.arrived_m or _GOAL_M)
    spots: list[Message] = [
        {
            "pose": pose(x, y, _THIN_M),
            "size": vector(across, across, _THIN_M),
            **_STRAIGHT,
            "color": _color(_GOAL, 0.5),
        }
        for x, y in playback.goals_m.tolist()
    ]
    return _entity("goals", cylinders=spots)


def _way(playback: Playback) -> Message:
    return _entity("way", lines=[_strip(playback.pose[:, :2].tolist(), _color(_WAY, 0.7))])


def _strip(points_m: Iterable[Sequence[float]], color: Message) -> Message:
    return {
        "type": _LINE_STRIP,
        "pose": pose(0.0, 0.0, 2 * _THIN_M),
        "thickness": 2 * _THIN_M,
        "scale_invariant": False,
        "points": cast("JsonValue", [vector(x, y, 0.0) for x, y in points_m]),
        "color": color,
        "colors": [],
        "indices": [],
    }


def _robot(playback: Playback) -> Message:
    """Returns the robot's own parts as they are at rest, its hull where they are not known, and where its front is."""
    (low, high), across = playback.heights_m, 2 * playback.radius_m
    shapes: dict[str, list[Message]] = {kind: [] for kind in _KINDS}
    for part in playback.shape:
        for kind, primitive in _part(part):
            shapes[kind].append(primitive)
    if not playback.shape:
        upright = {"pose": pose(0.0, 0.0, (low + high) / 2), "size": vector(across, across, high - low)}
        shapes["cylinders"].append({**upright, **_STRAIGHT, "color": _color(ROBOT.shares)})
    nose: Message = {
        "pose": pose(0.0, 0.0, high + _THIN_M),
        "shaft_length": 0.6 * playback.radius_m,
        "shaft_diameter": 0.1 * playback.radius_m,
        "head_length": 0.4 * playback.radius_m,
        "head_diameter": 0.3 * playback.radius_m,
        "color": _color(NOSE.shares),
    }
    shapes["arrows"].append(nose)
    return _entity("robot", ROBOT_FRAME, **shapes)


def _people(playback: Playback, sample: int, time_s: float) -> Message:
    """Returns the people of a sample as upright cylinders; the next sample's take their place."""
    places_m = playback.people_m[sample]
    return _upright("people", places_m, (0.0, PERSON_HEIGHT_M, PERSON_RADIUS_M), PERSON.shares, time_s)


def _robots(playback: Playback, sample: int, time_s: float) -> Message:
    """Returns the other robots of a sample in the same way."""
    return _upright("robots", playback.robots_m[sample], (*playback.heights_m, playback.radius_m), OTHER.shares, time_s)


def _boxes(boxes: BoxFilm, sample: int, time_s: float) -> Message:
    """Returns the boxes of a sample that stand there."""
    cubes: list[Message] = [
        {"pose": pose(x, y, size_m[2] / 2), "size": vector(*size_m), "color": _color(BOX.shares)}
        for (x, y), size_m in boxes.standing(sample)
    ]
    return {"deletions": [], "entities": [{**_entity("boxes", cubes=cubes), "timestamp": time_of(time_s)}]}


def _upright(
    name: str, places_m: np.ndarray, form_m: tuple[float, float, float], color: Color, time_s: float
) -> Message:
    low_m, high_m, radius_m = form_m
    size = vector(2 * radius_m, 2 * radius_m, high_m - low_m)
    cylinders: list[Message] = [
        {"pose": pose(x, y, (low_m + high_m) / 2), "size": size, **_STRAIGHT, "color": _color(color)}
        for x, y in places_m.tolist()
    ]
    entity: Message = {**_entity(name, cylinders=cylinders), "timestamp": time_of(time_s)}
    return {"deletions": [], "entities": [entity]}


def _part(part: RobotPart) -> Iterator[tuple[str, Message]]:
    """Yields the primitives that a part is made of, each with its kind."""
    w, x, y, z = part.turn
    turn: Message = {"x": x, "y": y, "z": z, "w": w}
    at: Message = {"position": vector(*part.position_m), "orientation": turn}
    color, (first, second, third) = _color(part.color[:3], part.color[3]), part.size
    if part.kind == "mesh":
        yield "triangles", _hull(part.vertices_m, at, color)
    elif part.kind == "box":
        yield "cubes", {"pose": at, "size": vector(2 * first, 2 * second, 2 * third), "color": color}
    elif part.kind in {"sphere", "ellipsoid"}:
        axes = part.size if part.kind == "ellipsoid" else (first, first, first)
        yield "spheres", {"pose": at, "size": vector(*(2 * axis for axis in axes)), "color": color}
    else:
        size = vector(2 * first, 2 * first, 2 * second)
        yield "cylinders", {"pose": at, "size": size, **_STRAIGHT, "color": color}
        along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        for end in (second, -second) if part.kind == "capsule" else ():
            middle: Message = {"position": vector(*(part.position_m + end * along)), "orientation": turn}
            yield "spheres", {"pose": middle, "size": vector(*[2 * first] * 3), "color": color}


def _color(color: Color, alpha: float = 1.0) -> Message:
    red, green, blue = color
    return {"r": red, "g": green, "b": blue, "a": alpha}


Schema = dict[str, JsonValue]

_NUMBER: Schema = {"type": "number"}
_TEXT: Schema = {"type": "string"}
_WHOLE: Schema = {"type": "integer"}
_FLAG: Schema = {"type": "boolean"}


def _object(**fields: Schema) -> Schema:
    return {"type": "object", "properties": cast("JsonValue", fields), "required": cast("JsonValue", [*fields])}


def _list(item: Schema) -> Schema:
    return {"type": "array", "items": item}


_TIME = _object(sec=_WHOLE, nsec=_WHOLE)
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_CUBE = _object(pose=_POSE, size=_VECTOR, color=_COLOR)
_SPHERE = _object(pose=_POSE, size=_VECTOR, color=_COLOR)
_CYLINDER = _object(pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOR)
_ARROW = _object(
    pose=_POSE,
    shaft_length=_NUMBER,
    shaft_diameter=_NUMBER,
    head_length=_NUMBER,
    head_diameter=_NUMBER,
    color=_COLOR,
)
_LINE = _object(
    type=_WHOLE,
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_FLAG,
    points=_list(_VECTOR),
    color=_COLOR,
    colors=_list(_COLOR),
    indices=_list(_WHOLE),
)
_TRIANGLES = _object(pose=_POSE, points=_list(_VECTOR), color=_COLOR, colors=_list(_COLOR), indices=_list(_WHOLE))
_ENTITY = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_TIME,
    frame_locked=_FLAG,
    metadata=_list(_object(key=_TEXT, value=_TEXT)),
    arrows=_list(_ARROW),
    cubes=_list(_CUBE),
    spheres=_list(_SPHERE),
    cylinders=_list(_CYLINDER),
    lines=_list(_LINE),
    triangles=_list(_TRIANGLES),
    texts=_list(_object()),
    models=_list(_object()),
)

STEP = "simyard.Step"
SCHEMAS: Mapping[str, Schema] = {
    "foxglove.FrameTransform": _object(
        timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_QUATERNION
    ),
    "foxglove.PoseInFrame": _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE),
    "foxglove.LaserScan": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_POSE,
        start_angle=_NUMBER,
        end_angle=_NUMBER,
        ranges=_list(_NUMBER),
        intensities=_list(_NUMBER),
    ),
    "foxglove.RawImage": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        width=_WHOLE,
        height=_WHOLE,
        encoding=_TEXT,
        step=_WHOLE,
        data={"type": "string", "contentEncoding": "base64"},
    ),
    "foxglove.CompressedImage": _object(
        timestamp=_TIME, frame_id=_TEXT, format=_TEXT, data={"type": "string", "contentEncoding": "base64"}
    ),
    "foxglove.CameraCalibration": _object(
        timestamp=_TIME,
        frame_id=_TEXT,
        width=_WHOLE,
        height=_WHOLE,
        distortion_model=_TEXT,
        D=_list(_NUMBER),
        K=_list(_NUMBER),
        R=_list(_NUMBER),
        P=_list(_NUMBER),
    ),
    "foxglove.SceneUpdate": _object(deletions=_list(_object()), entities=_list(_ENTITY)),
    STEP: _object(
        timestamp=_TIME,
        goal_index=_WHOLE,
        impulse_ns=_NUMBER,
        velocity_m_s=_list(_NUMBER),
        control=_list(_NUMBER),
    ),
}
"""By name; ``title`` is added when they are written."""


TOPICS = {
    "/tf": "foxglove.FrameTransform",
    "/pose": "foxglove.PoseInFrame",
    "/scan": "foxglove.LaserScan",
    "/scene": "foxglove.SceneUpdate",
    "/step": STEP,
}
"""The schema of each topic."""

PEOPLE_TOPICS = {"/people": "foxglove.SceneUpdate"}
"""The same of an episode with people."""

ROBOTS_TOPICS = {"/robots": "foxglove.SceneUpdate"}
"""The same of one whose robot is not alone."""

BOXES_TOPICS = {"/boxes": "foxglove.SceneUpdate"}
"""The same of one with boxes."""


def camera_topics(kind: str, name: str = "") -> dict[str, str]:
    """Returns the same of a robot's camera, which has topics of its own.

    Args:
        kind: Of the camera: ``depth`` or ``color``.
        name: Of one in a list.
    """
    # Viewers show raw depths in colours; a PNG of them is a third smaller, and nearly black (docs/guide/replay.md).
    picture = "foxglove.RawImage" if kind == "depth" else "foxglove.CompressedImage"
    topic = f"/{name}/{kind}" if name else f"/{kind}"
    return {topic: picture, f"{topic}/calibration": "foxglove.CameraCalibration"}


def write_mcap(path: Path, world: World, playback: Playback) -> None:
    """Writes an episode as MCAP: the scene once, frame and pose for each sample, scan and step for each that acted.

    Args:
        path: The file, overwritten.
        world: Where the episode took place.
        playback: What the robot did.
    """
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="simyard")
        whole = {kind: film for kind, film in (("depth", playback.depth), ("color", playback.color)) if film}
        films = [(kind, film) for kind, every in whole.items() for film in every.apart]
        topics = {
            **TOPICS,
            **(PEOPLE_TOPICS if playback.people_m.shape[1] else {}),
            **(ROBOTS_TOPICS if playback.robots_m.shape[1] else {}),
            **(BOXES_TOPICS if playback.boxes else {}),
            **{
                topic: schema for kind, film in films for topic, schema in camera_topics(kind, film.camera.name).items()
            },
        }
        channels = {topic: _channel(writer, topic, schema) for topic, schema in topics.items()}
        writer.add_metadata("simyard", {"job": playback.job, "world": world.name, "ending": playback.ending})
        seen = (_camera_messages(kind, film) for kind, film in films)
        messages = heapq.merge(_messages(world, playback), *seen, key=itemgetter(0))
        for number, (time_s, topic, message) in enumerate(messages):
            at_ns = nanoseconds_of(time_s)
            body = json.dumps(message, separators=(",", ":")).encode()
            writer.add_message(channels[topic], log_time=at_ns, publish_time=at_ns, data=body, sequence=number)
        writer.finish()


def _channel(writer: Writer, topic: str, name: str) -> int:
    document: dict[str, JsonValue] = {"title": name, **SCHEMAS[name]}
    schema = writer.register_schema(name, "jsonschema", json.dumps(document, sort_keys=True).encode())
    return writer.register_channel(topic, "json", schema)


def _messages(world: World, playback: Playback) -> Iterator[tuple[float, str, Message]]:
    """Yields time, topic and message, in the order of time."""
    yield 0.0, "/scene", scene(world, playback)
    along, across, yaw = playback.sight.mount
    yield 0.0, "/tf", _frame(0.0, ROBOT_FRAME, LIDAR_FRAME, (along, across, playback.sight.height_m), yaw)
    for sample, time_s in enumerate(playback.t_s.tolist()):
        x, y, yaw = playback.pose[sample].tolist()
        yield time_s, "/tf", _frame(time_s, WORLD_FRAME, ROBOT_FRAME, (x, y, 0.0), yaw)
        yield (
            time_s,
            "/pose",
            {"timestamp": time_of(time_s), "frame_id": WORLD_FRAME, "pose": pose(x, y, 0.0, yaw)},
        )
        if playback.people_m.shape[1]:
            yield time_s, "/people", _people(playback, sample, time_s)
        if playback.robots_m.shape[1]:
            yield time_s, "/robots", _robots(playback, sample, time_s)
        if playback.boxes:
            yield time_s, "/boxes", _boxes(playback.boxes, sample, time_s)
        if playback.acted[sample]:
            if playback.ranges_m.shape[1]:
                yield time_s, "/scan", _scan(playback, sample, time_s)
            yield time_s, "/step", _step(playback, sample, time_s)


def _camera_messages(kind: str, film: CameraFilm) -> Iterator[tuple[float, str, Message]]:
    """Yields where the camera is, how it projects, and what it saw: in its optical frame, ahead along z (REP 103)."""
    camera = film.camera
    frame, (topic, calibrated) = camera.own(_CAMERA_FRAMES[kind]), camera_topics(kind, camera.name)
    at = _frame(0.0, ROBOT_FRAME, frame, (camera.x_m, camera.y_m, camera.z_m), 0.0)
    x, y, z, w = optical_turn(camera.yaw_rad, camera.pitch_rad)
    at["rotation"] = {"x": x, "y": y, "z": z, "w": w}
    yield 0.0, "/tf", at
    focal_px = camera.columns / 2 / math.tan(camera.fov_rad / 2)
    across, down = camera.columns / 2, camera.rows / 2
    size: Message = {"frame_id": frame, "width": camera.columns, "height": camera.rows}
    calibration: Message = {
        **size,
        "timestamp": time_of(0.0),
        "distortion_model": "",
        "D": [],
        "K": [focal_px, 0.0, across, 0.0, focal_px, down, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [focal_px, 0.0, across, 0.0, 0.0, focal_px, down, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
    yield 0.0, calibrated, calibration
    for time_s, pixels in zip(film.t_s.tolist(), film.pictures, strict=True):
        picture: Message = {"format": "jpeg"}
        if pixels.dtype == np.uint8:
            data = jpeg_bytes(pixels)
        else:
            shown = depths_in_mm(pixels, camera.range_m).astype("<u2")
            data, picture = shown.tobytes(), {**size, "encoding": "16UC1", "step": shown[0].nbytes}
        stamp: Message = {"timestamp": time_of(time_s), "frame_id": frame}
        yield time_s, topic, {**stamp, **picture, "data": base64.b64encode(data).decode()}


def _frame(time_s: float, parent: str, child: str, place_m: tuple[float, float, float], yaw_rad: float) -> Message:
    return {
        "timestamp": time_of(time_s),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": vector(*place_m),
        "rotation": quaternion(yaw_rad),
    }


def _scan(playback: Playback, sample: int, time_s: float) -> Message:
    angles = playback.sight.angles_rad
    return {
        "timestamp": time_of(time_s),
        "frame_id": LIDAR_FRAME,
        "pose": pose(0.0, 0.0),
        "start_angle": float(angles[0]),
        "end_angle": float(angles[-1]),
        "ranges": playback.ranges_m[sample].tolist(),
        "intensities": [],
    }


def _step(playback: Playback, sample: int, time_s: float) -> Message:
    return {
        "timestamp": time_of(time_s),
        "goal_index": int(playback.goal_index[sample]),
        "impulse_ns": float(playback.impulse_ns[sample]),
        "velocity_m_s": playback.velocity[sample].tolist(),
        "control": playback.control[sample].tolist(),
    }
