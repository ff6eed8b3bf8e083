"""A robot filmed in three dimensions, where a GL is there: it is where it is put, and behind what stands before it."""

from collections.abc import Generator

import numpy as np
import pytest

from tasks.export.picture.renderer import FilmScene, Pixels, Shoot, open_film, open_renderer
from tests.factories.worlds import apartment
from tests.servers.tools import skip_or_fail

pytestmark = pytest.mark.long

WIDTH, HEIGHT = 320, 240
SCENE = FilmScene(world=apartment(), radius_m=0.2, low_m=0.0, high_m=0.3)


@pytest.fixture(scope="module")
def shoot() -> Generator[Shoot, None, None]:
    with open_film(SCENE, WIDTH, HEIGHT, samples=2) as found:
        if found is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
        yield found


def robot(pixels: Pixels) -> np.ndarray:
    """Returns where the robot's orange is, as rows and columns."""
    red, green, blue = (pixels[:, :, channel].astype(int) for channel in range(3))
    return np.argwhere((red > 150) & (red > green + 40) & (green > blue + 60))


def test_the_robot_is_where_it_is_put(shoot: Shoot):
    west, east = robot(shoot(-1.5, 0.5, 0.0)), robot(shoot(1.0, 0.5, 0.0))
    assert len(west) > 20
    assert west[:, 1].mean() + 30 < east[:, 1].mean()


def test_only_the_robot_moves(shoot: Shoot):
    before, after = shoot(-1.5, 0.5, 0.0), shoot(1.0, 0.5, 0.0)
    changed = np.argwhere((before != after).any(axis=2))
    assert 50 < len(changed) < 0.02 * WIDTH * HEIGHT


def test_what_stands_still_is_rendered_as_any_picture_of_the_world(shoot: Shoot):
    with open_renderer(WIDTH, HEIGHT, 2) as render:
        assert render
        alone = render(SCENE.world, ())
    assert (shoot(1.0, 0.5, 0.0) != alone).any(axis=2).mean() < 0.01


def test_it_points_ahead(shoot: Shoot):
    assert (shoot(0.0, 0.5, 0.0) != shoot(0.0, 0.5, np.pi / 2)).any()
    np.testing.assert_array_equal(shoot(0.0, 0.5, 0.0), shoot(0.0, 0.5, 0.0))


def test_it_is_hidden_by_what_stands_before_it(shoot: Shoot):
    assert len(robot(shoot(0.0, -1.5, 0.0))) == 0  # within the sofa, whose seat is higher


def test_without_gl_there_is_no_film_and_no_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with open_film(SCENE, WIDTH, HEIGHT) as found:
        assert found is None
