"""Writes an episode as an MCAP file that Foxglove opens: frames, poses, scans, the scene, and the controls.

Its times are simulated ones from 0. Needs the extra ``mcap``.
"""

import json
from collections.abc import Iterator
from pathlib import Path

from mcap.writer import CompressionType, Writer
from pydantic import JsonValue

from specs.data.world import World
from tasks.results.playback.foxglove import (
    LIDAR_FRAME,
    ROBOT_FRAME,
    SCHEMAS,
    STEP,
    WORLD_FRAME,
    Message,
    nanoseconds_of,
    pose,
    quaternion,
    scene,
    time_of,
    vector,
)
from tasks.results.playback.playback import Playback

TOPICS = {
    "/tf": "foxglove.FrameTransform",
    "/pose": "foxglove.PoseInFrame",
    "/scan": "foxglove.LaserScan",
    "/scene": "foxglove.SceneUpdate",
    "/step": STEP,
}
"""The schema of each topic."""


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
        channels = {topic: _channel(writer, topic, schema) for topic, schema in TOPICS.items()}
        writer.add_metadata("simyard", {"job": playback.job, "world": world.name, "ending": playback.ending})
        for number, (time_s, topic, message) in enumerate(_messages(world, playback)):
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
        if playback.acted[sample]:
            if playback.ranges_m.shape[1]:
                yield time_s, "/scan", _scan(playback, sample, time_s)
            yield time_s, "/step", _step(playback, sample, time_s)


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
