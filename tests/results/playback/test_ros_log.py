"""What cameras saw is in the bag of an episode: of a replay, and of a recording that keeps pictures."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from specs.ros_robot import RosDepthCamera, RosRobot, RosTopics
from tasks.results.playback.playback import Playback
from tasks.results.playback.ros_log import RosView, playback_log, sample_logs
from tasks.ros.bag.bag_file import write_bags
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.message.camera_messages import depth_png, jpeg_bytes
from tests.factories.bag_messages import read_bag
from tests.factories.playbacks import playback, seen_playback
from tests.factories.simulations import pen

DEPTH, COLOR, INFO = "/camera/depth/image_raw", "/camera/color/image_raw/compressed", "/camera/depth/camera_info"
VIEW = RosView(pen(6.0, 0))
MM = np.array([4000, 2000, 100], np.uint16)


def recorded(seen: Playback) -> dict[str, np.ndarray]:
    """Returns the same as samples of a recording with pictures."""
    assert seen.depth
    assert seen.color
    rows = len(seen.t_s)
    kept = {name: np.full(rows, None, object) for name in ("depth_png", "color_jpeg", "depth_camera", "color_camera")}
    kept["depth_camera"][:], kept["color_camera"][:] = seen.depth.camera, seen.color.camera
    for number, at in enumerate((0, 8, 16)):
        kept["depth_png"][at] = depth_png(seen.depth.pictures[number], 6.0)
        kept["color_jpeg"][at] = jpeg_bytes(seen.color.pictures[number])
    names = ("t_s", "pose", "velocity", "goal_index", "acted", "control", "ranges_m", "impulse_ns")
    own = {name: getattr(seen, name) for name in names}
    lidar = np.tile([0.1, 0.0, 0.0, 0.2, 6.0, -0.5, 0.25], (rows, 1))
    return {"index": np.zeros(rows, int), "goal_m": np.ones((rows, 2)), "lidar": lidar, **own, **kept}


def turned() -> Playback:
    """Returns the playback with a depth camera that is turned to the left, and looks down."""
    seen = seen_playback()
    assert seen.depth
    camera = seen.depth.camera.model_copy(update={"yaw_rad": 0.5, "pitch_rad": 0.2})
    return replace(seen, depth=replace(seen.depth, camera=camera))


def of_replay(view: RosView) -> MessageLog:
    return playback_log(view, turned())


def of_recording(view: RosView) -> MessageLog:
    ((_, log),) = sample_logs({0: view}, recorded(turned()))
    return log


Made = Callable[[RosView], MessageLog]
both = pytest.mark.parametrize("made", [of_replay, of_recording])


def read(log: MessageLog, folder: Path) -> Mapping[str, list[Any]]:
    """Returns the messages of each topic as another library reads them from a bag."""
    (path,) = write_bags(folder, "one", log, ["rosbag"])
    return {each.topic: read_bag(path, each.topic) for each in log.channels}


@both
def test_pictures_are_there_at_the_moments_at_which_they_were_taken(made: Made, tmp_path: Path):
    found = read(made(VIEW), tmp_path)
    for topic in (DEPTH, COLOR, INFO):
        stamps = [each.header.stamp for each in found[topic]]
        assert [each.sec + each.nanosec / 1e9 for each in stamps] == [1.0, 1.4, 1.8]
    depths = [each.data.view("<u2").reshape(each.height, each.width) for each in found[DEPTH]]
    assert {each.encoding for each in found[DEPTH]} == {"16UC1"}
    assert_array_equal([each[0, 0] for each in depths], MM)
    assert all((each[:, 4:] == 0).all() for each in depths)
    assert found[COLOR][1].data.tobytes() == jpeg_bytes(np.full((4, 6, 3), 120, np.uint8))
    assert (found[INFO][0].width, found[INFO][0].height) == (8, 4)


@both
def test_cameras_have_frames_on_the_robot(made: Made, tmp_path: Path):
    found = read(made(VIEW), tmp_path)
    edges = {each.child_frame_id: each for each in found["/tf_static"][0].transforms}
    for topic in (DEPTH, COLOR):
        frame = edges[found[topic][0].header.frame_id]
        assert (frame.header.frame_id, frame.transform.translation.z) == ("base_link", 0.3)
    turn = edges[found[DEPTH][0].header.frame_id].transform.rotation
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    ahead = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]  # the optical frame's z axis
    assert_allclose(ahead, [np.cos(0.5) * np.cos(0.2), np.sin(0.5) * np.cos(0.2), -np.sin(0.2)], atol=1e-6)


@both
def test_depths_are_in_the_form_of_the_robots_own_pictures(made: Made, tmp_path: Path):
    topics = RosTopics(depth_image="/eye", color_image=None)
    found = read(made(VIEW._replace(robot=RosRobot(depth_camera=RosDepthCamera(), topics=topics))), tmp_path)
    assert {each.encoding for each in found["/eye"]} == {"32FC1"}
    depths = [each.data.view("<f4").reshape(4, 8) for each in found["/eye"]]
    assert_array_equal([each[0, 0] for each in depths], MM / np.float32(1000))
    assert all(np.isinf(each[:, 4:]).all() for each in depths)
    assert COLOR not in found


def test_what_is_no_picture_is_left_out_and_named(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    samples = recorded(seen_playback())
    samples["depth_png"][0] = samples["depth_png"][0][:40]
    samples["depth_png"][8] = depth_png(np.ones((4, 9)), 6.0)
    ((_, log),) = sample_logs({0: VIEW}, samples)
    with caplog.at_level(logging.WARNING):
        found = read(log, tmp_path)
    assert [each.header.stamp.nanosec for each in found[DEPTH]] == [800_000_000]
    assert len(caplog.messages) == 2
    assert "0.40 s: a picture of 9 x 4 pixels" in caplog.text


def test_a_robot_without_cameras_has_no_topics_of_them():
    assert not [each for each in playback_log(VIEW, playback()).channels if each.topic.startswith("/camera")]
