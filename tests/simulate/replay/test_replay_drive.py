"""A replay shows what a robot's cameras saw, to the last bit, though no picture was kept."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from specs.data.episode import CONTROL_S
from specs.data.world import World
from specs.field_types import EngineName
from tasks.simulate.geometry.depth_picture import View
from tasks.simulate.geometry.hull_picture import Mount, hull_picture
from tasks.simulate.replay.replay_drive import drive_replay
from tasks.simulate.replay.replay_result import ReplayResult, received_replay, replay_message
from tests.factories.simulations import FOLDERS, pushing
from tests.servers.tools import skip_or_fail

SEERS = {"jax": "5e" * 32, "plain": "5f" * 32}
CAMERA = """
class Camera:
    columns, rows, fov_rad, range_m, z_m = 12, 8, 1.2, 6.0, 0.3
    x_m, yaw_rad, rate_hz = 0.1, 0.2, 10.0
    sigma_m_per_m2, dropout, sees_robot = 0.01, 0.1, True


def controller(environment):
    return Seer()
"""
MODULES = {
    "jax": """
import jax.numpy as jnp


class Seer:
    depth_camera = Camera()

    def init(self, floor, goals_m):
        return ()

    def step(self, state, observation):
        return state, observation.depth_m[3, jnp.array([2, 5, 9])] * jnp.array([0.25, 1.0, 1.0])
""",
    "plain": """
import numpy as np

jax = False


class Seer:
    depth_camera = Camera()

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        assert type(observation.depth_m) is np.ndarray
        return observation.depth_m[3, [2, 5, 9]] * np.array([0.25, 1.0, 1.0], np.float32)
""",
}


COLORED = """
import numpy as np

jax = False


class Eye:
    columns, rows, rate_hz, noise, sees_robot = 12, 6, 10.0, 0.05, True


class Seer:
    color_camera = Eye()

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        return observation.color[3, [2, 5, 9], 1] / np.float32(256)


def controller(environment):
    return Seer()
"""


@pytest.mark.long
def test_a_replay_takes_the_pictures_in_colour_that_the_robot_saw(pens: dict[str, World], tmp_path: Path):
    again = replayed("60" * 32, COLORED, pens, tmp_path)
    setting, steps = again.setting, again.steps
    if again.row.failure_code == "InternalServiceError":
        skip_or_fail(again.row.failure_reason)
    assert setting is not None
    assert setting.color_camera is not None
    assert steps is not None
    assert again.gl
    taken = np.round(setting.colored_s / CONTROL_S).astype(int)
    acted = taken[np.asarray(steps["acted"], bool)[taken]]
    assert len(acted) > 3
    seen = setting.colors[: len(acted), 3][:, [2, 5, 9], 1] / np.float32(256)
    np.testing.assert_array_equal(steps["control"][acted], seen)
    assert len(np.unique(seen)) > 6


def replayed(digest: str, module: str, pens: dict[str, World], tmp_path: Path, engine: str = "planar") -> ReplayResult:
    """Returns an episode that a module drove, as it is sent."""
    drawn = pushing(0, world="hand/pen-0", seed=3, duration_s=3.0)
    (tmp_path / "seer").mkdir()
    (tmp_path / "seer/seer.py").write_text(module)
    (tmp_path / "robot.xml").write_text((FOLDERS[drawn.robot.digest] / "robot.xml").read_text())
    robot = drawn.robot.model_copy(update={"digest": digest, "package": "seer", "launch_file": "seer"})
    request = drawn.model_copy(update={"robot": robot})
    again = drive_replay(request, pens, {**FOLDERS, digest: tmp_path}, lanes=8, engine=engine, rate_hz=4.0)
    said, arrays = replay_message(again)
    return received_replay(said, tuple(arrays), 1000)


@pytest.mark.long
@pytest.mark.parametrize("kind", SEERS)
def test_a_replay_takes_the_pictures_that_the_robot_saw(kind: str, pens: dict[str, World], tmp_path: Path):
    sent = replayed(SEERS[kind], CAMERA + MODULES[kind], pens, tmp_path)
    assert sent.setting is not None
    assert sent.setting.camera is not None
    assert sent.steps is not None
    assert sent.setting.camera.rate_hz == 10.0
    taken = np.round(sent.setting.pictured_s / CONTROL_S).astype(int)
    assert len(taken) > 3
    acted = taken[np.asarray(sent.steps["acted"], bool)[taken]]
    seen = sent.setting.pictures_m[: len(acted), 3][:, [2, 5, 9]] * np.array([0.25, 1.0, 1.0], np.float32)
    np.testing.assert_array_equal(sent.steps["control"][acted], seen)
    assert len(np.unique(seen)) > 6


@pytest.mark.long
@pytest.mark.parametrize("engine", get_args(EngineName))
def test_on_every_engine_a_camera_sees_its_own_robot_where_it_drives(
    engine: str, pens: dict[str, World], tmp_path: Path
):
    behind = CAMERA.replace("x_m, yaw_rad", "x_m, pitch_rad").replace("0.1, 0.2, 10.0", "-0.4, 0.2, 10.0")
    exact = behind.replace("0.01, 0.1, True", "0.0, 0.0, True")
    setting = replayed("61" * 32, exact + MODULES["jax"], pens, tmp_path, engine).setting
    assert setting is not None
    own_m = hull_picture(tmp_path / "robot.xml", View(12, 8, 1.2, 0.2, 6.0), Mount(-0.4, 0.0, 0.3, 0.0))
    hull = own_m < 0.5
    assert 10 < hull.sum() < hull.size - 10
    assert len(setting.pictures_m) > 3
    for picture_m in setting.pictures_m:
        np.testing.assert_array_equal(picture_m[hull], own_m[hull])
        assert (picture_m[~hull] > 0.5).any()
