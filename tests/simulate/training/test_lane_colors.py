"""Pictures of lanes that are each at a control step of their own: at their rate, late, and of where the robot was."""

from collections.abc import Sequence

import numpy as np
import pytest

from specs.bundle_files import ColorCameraDeclaration
from specs.data.world import World
from tasks.render.camera_pool import Shot
from tasks.simulate.training import lane_colors
from tasks.simulate.training.lane_colors import ColorTask, LaneColors
from tests.factories.simulations import COURIER, FOLDERS, delivery, pen


class Drawer:
    """Stands for the processes that draw: a picture has its number, from 1, in all pixels."""

    def __init__(self) -> None:
        self.shots: list[Shot] = []

    def add(self, key: str, world: World, camera: ColorCameraDeclaration, robot: object) -> None:
        del key, world, camera, robot

    def color(self, shots: Sequence[Shot]) -> np.ndarray:
        self.shots += shots
        return np.stack([np.full((4, 6, 3), shot.number + 1, np.uint8) for shot in shots])


@pytest.fixture
def drawer(monkeypatch: pytest.MonkeyPatch) -> Drawer:
    made = Drawer()
    monkeypatch.setattr(lane_colors, "standing_cameras", lambda _: made)
    return made


def colors(rate_hz: float, latency_steps: int, lanes: int = 2) -> LaneColors:
    camera = ColorCameraDeclaration(columns=6, rows=4, rate_hz=rate_hz, latency_steps=latency_steps)
    requests = tuple(delivery(seed, world="hand/pen", seed=seed) for seed in (70, 80))
    return LaneColors(ColorTask(camera, requests, {"hand/pen": pen(4.0, 0)}, FOLDERS[COURIER] / "robot.xml"), lanes)


def at(own: LaneColors, steps: Sequence[int], episodes: Sequence[int] = (0, 1)) -> list[int]:
    poses = np.array([[step, lane, 0.0] for lane, step in enumerate(steps)], np.float32)
    return own.shown(np.array(steps), poses, np.array(episodes))[:, 0, 0, 0].tolist()


@pytest.mark.parametrize(
    ("rate_hz", "latency_steps", "shown"),
    [
        (0.0, 0, [1, 2, 3, 4, 5, 6, 7, 8]),
        (10.0, 0, [1, 1, 2, 2, 3, 3, 4, 4]),
        (5.0, 3, [0, 0, 0, 1, 1, 1, 1, 2]),
        (10.0, 3, [0, 0, 0, 1, 1, 2, 2, 3]),
        (0.0, 2, [0, 0, 1, 2, 3, 4, 5, 6]),
    ],
)
def test_pictures_come_as_in_a_batch_whenever_a_lane_began(
    rate_hz: float, latency_steps: int, shown: list[int], drawer: Drawer
):
    own = colors(rate_hz, latency_steps)
    seen = [at(own, [step, (step + 5) % 8]) for step in range(8)]
    assert [each[0] for each in seen] == shown
    assert [each[1] for each in seen][3:] == shown[:5], "the other lane begins anew three steps later"
    stride = 1 if rate_hz == 0.0 else round(20 / rate_hz)
    assert all(shot.x_m == shot.number * stride for shot in drawer.shots if shot.seed == 70)


def test_an_episode_that_begins_is_drawn_although_its_picture_has_the_number_of_the_last_one(drawer: Drawer):
    own = colors(1.0, 0)
    at(own, [0, 0])
    at(own, [1, 1])
    at(own, [0, 2], [1, 1])
    assert [(shot.seed, shot.number) for shot in drawer.shots] == [(70, 0), (80, 0), (80, 0)]


def test_nobody_draws_from_nowhere(drawer: Drawer):
    own = colors(0.0, 0)
    at(own, [0, 0])
    poses = np.array([[np.nan, 0.0, 0.0], [1.0, 0.0, 0.0]], np.float32)
    shown = own.shown(np.array([1, 1]), poses, np.array([0, 1]))
    assert shown[:, 0, 0, 0].tolist() == [1, 2]
