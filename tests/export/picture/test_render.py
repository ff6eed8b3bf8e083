"""Pictures in three dimensions, where a GL is there."""

import sys
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

from specs.data.world import Finish, World
from specs.errors import SimyardError
from tasks.export.picture import renderer
from tasks.export.picture.renderer import Pixels, Render, open_renderer, render_png
from tests.export.png_reader import decoded
from tests.factories.worlds import apartment
from tests.servers.tools import skip_or_fail

WIDTH, HEIGHT, SAMPLES = 160, 120, 4


@pytest.fixture(scope="module")
def render() -> Generator[Render, None, None]:
    with open_renderer(WIDTH, HEIGHT, SAMPLES) as found:
        if found is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
        yield found


def floored(color: tuple[float, float, float], pattern: str = "plain") -> World:
    """Returns the apartment without furniture, its living room floored in a colour."""
    accent = color if pattern == "plain" else (0.0, 0.0, 0.0)
    flooring = Finish.model_validate(
        {"material": "any", "pattern": pattern, "color": color, "accent": accent, "repeat_m": (0.5, 0.5)}
    )
    living, kitchen = apartment().rooms
    rooms = (living.model_copy(update={"flooring": flooring}), kitchen)
    return apartment().model_copy(update={"rooms": rooms, "furniture": ()})


def living_floor(pixels: Pixels) -> np.ndarray:
    """Returns the pixels of the western half's middle: the living room lies there."""
    return pixels[50:75, 40:65].astype(float)


def test_a_picture_shows_something(render: Render):
    pixels = render(apartment(), ())
    assert pixels.shape == (HEIGHT, WIDTH, 3)
    assert pixels.std() > 20.0


def test_the_same_world_gives_the_same_pixels(render: Render):
    np.testing.assert_array_equal(render(apartment(), ()), render(apartment(), ()))


def test_a_floor_has_the_colour_of_its_finish(render: Render):
    red, _, blue = living_floor(render(floored((0.9, 0.1, 0.1)), ())).mean((0, 1))
    assert red > 2 * blue
    red, _, blue = living_floor(render(floored((0.1, 0.1, 0.9)), ())).mean((0, 1))
    assert blue > 2 * red


def test_a_pattern_is_seen(render: Render):
    plain = living_floor(render(floored((0.9, 0.9, 0.9)), ())).std()
    assert living_floor(render(floored((0.9, 0.9, 0.9), "tiles"), ())).std() > plain + 5.0


def test_a_picture_without_furniture_is_another(render: Render):
    bare = apartment().model_copy(update={"furniture": ()})
    assert np.abs(render(apartment(), ()).astype(int) - render(bare, ())).max() > 40


def test_a_name_that_is_no_text_is_no_obstacle(render: Render):
    odd = apartment(room_names=("new\nline", "\x00 </svg>"))
    assert render(odd, ()).std() > 20.0


def test_a_png_holds_the_picture(render: Render):
    del render  # only asked for so that the test is skipped where there is no GL
    file = render_png(apartment(), 80, 60)
    assert file is not None
    assert decoded(file).shape == (60, 80, 3)


def test_without_gl_there_is_no_picture_and_no_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert render_png(apartment(), 80, 60) is None


def test_a_renderer_that_fails_says_why(render: Render):
    del render
    twice = apartment().model_copy(update={"walls": apartment().walls * 2})
    with open_renderer(80, 60, 1) as mine:
        assert mine is not None
        with pytest.raises(RuntimeError, match=r"(?s)rendering world-1-1 failed.*repeated name"):
            mine(twice, ())


@pytest.mark.parametrize(
    ("limit", "says", "why"),
    [
        ("_START_S", "", "hangs at its start with MUJOCO_GL=osmesa"),
        ("_ANSWER_S", "echo GL;", "rendering world-1-1 failed"),
    ],
)
def test_a_renderer_that_hangs_is_ended_with_the_reason(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limit: str, says: str, why: str
):
    silent = tmp_path / "python"
    silent.write_text(f"#!/bin/sh\n{says} exec sleep 1000\n")
    silent.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(silent))
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(renderer, limit, 0.2)
    with pytest.raises(SimyardError, match=rf"{why}.*no answer within 0\.2 s"):
        render_png(apartment(), 80, 60)
