"""The MCAP file, read back by the library that is made for it."""

import base64
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import Image

from specs.bundle_files import ColorCameraDeclaration, DepthCameraDeclaration
from specs.data.people import PERSON_HEIGHT_M
from specs.data.robot_shape import RobotPart
from specs.data.world import FloorZone, solids
from tasks.results.playback.playback import CameraFilm
from tasks.results.playback.replay_mcap import (
    BOXES_TOPICS,
    PEOPLE_TOPICS,
    ROBOTS_TOPICS,
    TOPICS,
    camera_topics,
    scene,
    write_mcap,
)
from tests.factories.own_worlds import WEDGE, piece, wedge
from tests.factories.playbacks import RAYS, SAMPLES, boxed_playback, playback
from tests.factories.worlds import apartment

WORLD = apartment()
Found = dict[str, list[tuple[int, dict[str, Any]]]]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "replay.mcap"
    write_mcap(path, WORLD, playback())
    return path


@pytest.fixture(scope="module")
def found(file: Path) -> Found:
    messages: Found = {topic: [] for topic in TOPICS}
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened, validate_crcs=True).iter_messages():
            assert schema
            assert (schema.name, schema.encoding, channel.message_encoding) == (
                TOPICS[channel.topic],
                "jsonschema",
                "json",
            )
            body = json.loads(message.data)
            assert body.keys() == json.loads(schema.data)["properties"].keys()
            messages[channel.topic].append((message.log_time, body))
    return messages


def test_there_are_as_many_messages_as_samples(found: Found, file: Path):
    counts = {topic: len(messages) for topic, messages in found.items()}
    # One frame more: the lidar's on the robot. Nothing was seen or decided in the state in which it ended.
    assert counts == {"/tf": SAMPLES + 1, "/pose": SAMPLES, "/scan": SAMPLES - 1, "/step": SAMPLES - 1, "/scene": 1}
    with file.open("rb") as opened:
        summary = make_reader(opened).get_summary()
    assert summary
    assert summary.statistics
    assert summary.statistics.message_count == sum(counts.values())


def test_people_stand_where_they_are_in_each_sample(tmp_path: Path):
    write_mcap(tmp_path / "people.mcap", WORLD, playback(people=2))
    with (tmp_path / "people.mcap").open("rb") as opened:
        updates = [
            json.loads(message.data)
            for _, channel, message in make_reader(opened).iter_messages(topics=["/people"])
            if channel.topic in PEOPLE_TOPICS
        ]
    assert len(updates) == SAMPLES
    (entity,) = updates[10]["entities"]
    places = [each["pose"]["position"] for each in entity["cylinders"]]
    assert [(place["x"], place["y"]) for place in places] == [(0.25, 1.0), (0.25, 2.0)]
    assert [each["size"]["z"] for each in entity["cylinders"]] == [PERSON_HEIGHT_M] * 2


def test_boxes_are_there_in_the_samples_in_which_they_stand(tmp_path: Path):
    write_mcap(tmp_path / "boxes.mcap", WORLD, boxed_playback())
    with (tmp_path / "boxes.mcap").open("rb") as opened:
        put = [json.loads(message.data) for _, _, message in make_reader(opened).iter_messages(topics=[*BOXES_TOPICS])]
    counts = [len(each["entities"][0]["cubes"]) for each in put]
    middle = SAMPLES // 2
    assert counts == [*[0] * middle, *[2] * (SAMPLES - 2 - middle), 1, 1]
    (last,) = put[-1]["entities"][0]["cubes"]
    assert last["pose"]["position"] == {"x": 2.0, "y": 1.5, "z": 0.5}
    assert last["size"] == {"x": 0.3, "y": 1.2, "z": 1.0}


def test_other_robots_stand_where_they_are_in_each_sample(tmp_path: Path):
    write_mcap(tmp_path / "robots.mcap", WORLD, playback(robots=2))
    with (tmp_path / "robots.mcap").open("rb") as opened:
        updates = [
            json.loads(message.data)
            for _, channel, message in make_reader(opened).iter_messages(topics=["/robots"])
            if channel.topic in ROBOTS_TOPICS
        ]
    assert len(updates) == SAMPLES
    (entity,) = updates[10]["entities"]
    places = [each["pose"]["position"] for each in entity["cylinders"]]
    assert [(place["x"], place["y"], place["z"]) for place in places] == [(0.5, -1.0, 0.15), (0.5, -2.0, 0.15)]
    assert [each["size"] for each in entity["cylinders"]] == [{"x": 0.4, "y": 0.4, "z": 0.3}] * 2


def test_a_robot_with_cameras_shows_what_it_saw_where_it_saw_it(tmp_path: Path):
    camera = DepthCameraDeclaration(columns=4, rows=2, range_m=6.0, x_m=0.2, z_m=0.4, rate_hz=5)
    depth_m = np.array([[[1.0, 2.5, 6.0, 6.0]] * 2] * 3, np.float32)
    film = CameraFilm(camera, np.array([0.0, 0.2, 0.4]), depth_m)
    eye = ColorCameraDeclaration(columns=3, rows=2, z_m=0.5)
    colors = np.full((2, 2, 3, 3), (200, 120, 40), np.uint8) - np.array([0, 30], np.uint8)[:, None, None, None]
    color = CameraFilm(eye, np.array([0.0, 0.5]), colors)
    write_mcap(tmp_path / "seen.mcap", WORLD, replace(playback(), depth=film, color=color))
    with (tmp_path / "seen.mcap").open("rb") as opened:
        messages = [
            (channel.topic, message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(opened, validate_crcs=True).iter_messages(log_time_order=False)
        ]
    assert [at_ns for _, at_ns, _ in messages] == sorted(at_ns for _, at_ns, _ in messages)
    pictures = [(at_ns, body) for topic, at_ns, body in messages if topic == "/depth"]
    assert [at_ns for at_ns, _ in pictures] == [0, 200_000_000, 400_000_000]
    seen_mm = np.frombuffer(base64.b64decode(pictures[0][1]["data"]), "<u2").reshape(2, 4)
    assert seen_mm.tolist() == [[1000, 2500, 0, 0]] * 2
    (frame,) = [body for topic, _, body in messages if topic == "/tf" and body["child_frame_id"] == "camera"]
    assert frame["rotation"] == {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}
    seen = [(at_ns, body) for topic, at_ns, body in messages if topic == "/color"]
    assert [(at_ns, body["format"]) for at_ns, body in seen] == [(0, "jpeg"), (500_000_000, "jpeg")]
    unpacked = [np.asarray(Image.open(io.BytesIO(base64.b64decode(body["data"])))) for _, body in seen]
    np.testing.assert_allclose(np.array(unpacked, int), colors, atol=3)
    frames = {body["child_frame_id"] for topic, _, body in messages if topic == "/tf"}
    assert {body["frame_id"] for _, body in (*pictures, *seen)} < frames
    assert {topic for topic, _, _ in messages} == {*TOPICS, *camera_topics("depth"), *camera_topics("color")}


def test_time_is_simulated_time(found: Found):
    assert [at_ns for at_ns, _ in found["/pose"]] == [50_000_000 * number for number in range(SAMPLES)]
    assert found["/pose"][3][1]["timestamp"] == {"sec": 0, "nsec": 150_000_000}


def test_the_robot_is_where_it_was(found: Found):
    _, body = found["/tf"][-1]
    assert (body["parent_frame_id"], body["child_frame_id"]) == ("world", "robot")
    assert body["translation"] == {"x": 1.0, "y": 0.5, "z": 0.0}
    half_rad = (1.0 - 0.2 - np.pi) / 2
    expected = {"x": 0.0, "y": 0.0, "z": pytest.approx(np.sin(half_rad)), "w": pytest.approx(np.cos(half_rad))}
    assert body["rotation"] == expected
    assert body["rotation"] == found["/pose"][-1][1]["pose"]["orientation"]


def test_scans_are_seen_from_the_lidar(found: Found):
    _, mount = found["/tf"][0]
    assert (mount["parent_frame_id"], mount["child_frame_id"]) == ("robot", "lidar")
    assert mount["translation"] == {"x": pytest.approx(0.1), "y": 0.0, "z": pytest.approx(0.2)}
    _, scan = found["/scan"][0]
    assert scan["frame_id"] == "lidar"
    assert scan["ranges"] == [1.5] * RAYS
    assert scan["end_angle"] - scan["start_angle"] == pytest.approx(2 * 3.14159265 * (RAYS - 1) / RAYS)


def test_zones_are_outlines_on_the_floor():
    zone = FloorZone(name="dock", outline_m=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), found=False)
    zoned = WORLD.model_copy(update={"rooms": (), "zones": (zone,)})
    entities: Any = scene(zoned, playback())["entities"]
    (line,) = entities[0]["lines"]
    assert [(at["x"], at["y"]) for at in line["points"]] == [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 0.0)]


def test_the_scene_has_every_solid_and_the_robot(found: Found):
    (_, scene) = found["/scene"][0]
    entities = {entity["id"]: entity for entity in scene["entities"]}
    drawn = ["walls", *(piece.name for piece in WORLD.furniture)]
    assert sum(len(entities[name]["cubes"]) + len(entities[name]["cylinders"]) for name in drawn) == len(solids(WORLD))
    low = entities["sofa-1"]["cubes"][0]
    assert low["size"] == {"x": 2.0, "y": 0.9, "z": 0.45}
    assert low["pose"]["position"] == {"x": 0.0, "y": -1.55, "z": 0.225}
    assert entities["robot"]["frame_id"] == "robot"
    assert entities["robot"]["cylinders"][0]["size"] == {"x": 0.4, "y": 0.4, "z": 0.3}
    assert len(entities["goals"]["cylinders"]) == 2


def test_a_prism_is_drawn_by_the_triangles_around_its_corners():
    own = WORLD.model_copy(update={"furniture": (piece("rack", wedge("rack", (1.0, 2.0), low_m=0.5)),)})
    entities: Any = scene(own, playback())["entities"]
    (rack,) = next(entity["triangles"] for entity in entities if entity["id"] == "rack")
    assert {(at["x"], at["y"]) for at in rack["points"]} == {(1.0 + x, 2.0 + y) for x, y in WEDGE}
    assert {at["z"] for at in rack["points"]} == {0.5, 1.5}
    assert len(rack["indices"]) == 3 * 12


def test_a_robot_whose_parts_are_known_is_drawn_by_them():
    lying = {"position_m": (0.1, 0.0, 0.2), "turn": (0.5**0.5, 0.0, 0.5**0.5, 0.0), "color": (1.0, 0.0, 0.0, 0.5)}
    sizes = {
        "box": (0.3, 0.2, 0.1),
        "sphere": (0.1, 0.0, 0.0),
        "cylinder": (0.1, 0.02, 0.0),
        "capsule": (0.1, 0.3, 0.0),
    }
    parts = [
        RobotPart.model_validate({"kind": kind, "size": size, "outline_m": (), "top_m": 0.3, **lying})
        for kind, size in sizes.items()
    ]
    corners = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    solid = parts[0].model_copy(update={"kind": "mesh", "vertices_m": corners})
    entities: Any = scene(WORLD, replace(playback(), shape=(*parts, solid)))["entities"]
    robot = next(entity for entity in entities if entity["id"] == "robot")
    assert robot["frame_id"] == "robot"
    assert [len(robot[kind]) for kind in ("cubes", "spheres", "cylinders", "triangles")] == [1, 3, 2, 1]
    assert robot["cubes"][0]["size"] == {"x": 0.6, "y": 0.4, "z": 0.2}
    assert robot["cubes"][0]["color"] == {"r": 1.0, "g": 0.0, "b": 0.0, "a": 0.5}
    ends = [ball["pose"]["position"]["x"] for ball in robot["spheres"][1:]]
    assert ends == pytest.approx([0.4, -0.2]), "the capsule lies along x"
    assert sorted(np.bincount(robot["triangles"][0]["indices"])) == [3, 3, 3, 3]


def test_the_same_episode_is_the_same_bytes(file: Path, tmp_path: Path):
    write_mcap(tmp_path / "again.mcap", WORLD, playback())
    assert (tmp_path / "again.mcap").read_bytes() == file.read_bytes()


def test_a_blind_robot_has_no_scans(tmp_path: Path):
    write_mcap(tmp_path / "blind.mcap", WORLD, playback(rays=0))
    with (tmp_path / "blind.mcap").open("rb") as opened:
        assert not list(make_reader(opened).iter_messages(topics="/scan"))
