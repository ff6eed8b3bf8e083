"""Pictures in three dimensions, where a GL is there."""

import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import numpy as np
import pytest

from specs.data.world import Finish, World
from specs.errors import SimyardError
from tasks.export.picture.renderer import (
    CAPTION_LINE,
    FilmScene,
    Pixels,
    Render,
    Shoot,
    open_film,
    open_renderer,
    render_png,
    render_sheet_png,
)
from tasks.render import gl_process
from tests.export.png_reader import decoded
from tests.factories.playbacks import DECK, WHEEL
from tests.factories.worlds import apartment
from tests.servers.tools import skip_or_fail

WIDTH, HEIGHT, SAMPLES = 160, 120, 4
FILM_WIDTH, FILM_HEIGHT = 320, 240
SCENE = FilmScene(world=apartment(), radius_m=0.2, low_m=0.0, high_m=0.3)


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


def test_without_gl_there_is_no_picture_sheet_or_film_and_no_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert render_png(apartment(), 80, 60) is None
    assert render_sheet_png([apartment()]) is None
    with open_film(SCENE, FILM_WIDTH, FILM_HEIGHT) as found:
        assert found is None


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
    monkeypatch.setattr(gl_process, limit, 0.2)
    with pytest.raises(SimyardError, match=rf"{why}.*no answer within 0\.2 s"):
        render_png(apartment(), 80, 60)


@pytest.fixture(scope="module")
def shoot() -> Generator[Shoot, None, None]:
    with open_film(SCENE, FILM_WIDTH, FILM_HEIGHT, samples=2) as found:
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


@pytest.mark.long
def test_only_the_robot_moves(shoot: Shoot):
    before, after = shoot(-1.5, 0.5, 0.0), shoot(1.0, 0.5, 0.0)
    changed = np.argwhere((before != after).any(axis=2))
    assert 50 < len(changed) < 0.02 * FILM_WIDTH * FILM_HEIGHT


@pytest.mark.long
def test_what_stands_still_is_rendered_as_any_picture_of_the_world(shoot: Shoot):
    with open_renderer(FILM_WIDTH, FILM_HEIGHT, 2) as render:
        assert render
        alone = render(SCENE.world, ())
    assert (shoot(1.0, 0.5, 0.0) != alone).any(axis=2).mean() < 0.01


@pytest.mark.long
def test_it_points_ahead(shoot: Shoot):
    assert (shoot(0.0, 0.5, 0.0) != shoot(0.0, 0.5, np.pi / 2)).any()
    np.testing.assert_array_equal(shoot(0.0, 0.5, 0.0), shoot(0.0, 0.5, 0.0))


@pytest.mark.long
def test_it_is_filmed_as_its_parts():
    shaped = SCENE.model_copy(update={"shape": (WHEEL, DECK)})
    with open_film(shaped, FILM_WIDTH, FILM_HEIGHT, samples=2) as found:
        if found is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
        red, _, blue = (found(1.0, 0.5, 0.0)[:, :, channel].astype(int) for channel in range(3))
        gone = found(1.0, 0.5, 0.0)
    assert (blue > red + 60).sum() > 20
    assert len(robot(gone)) == 0, "no orange hull"


@pytest.mark.long
def test_people_are_where_they_are_put_and_nowhere_before():
    with open_film(SCENE.model_copy(update={"people": 2}), FILM_WIDTH, FILM_HEIGHT, samples=2) as found:
        if found is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
        west, east = (found(0.0, 0.5, 0.0, ((x, 0.5), (x, 1.0))) for x in (-1.5, 1.0))
    places = [np.argwhere(each[:, :, 2].astype(int) > each[:, :, 1].astype(int) + 80) for each in (west, east)]
    assert all(len(each) > 100 for each in places)
    assert places[0][:, 1].mean() + 30 < places[1][:, 1].mean()


@pytest.mark.long
def test_other_robots_are_where_they_are_put_behind_the_people():
    with open_film(SCENE.model_copy(update={"people": 1, "robots": 1}), FILM_WIDTH, FILM_HEIGHT, samples=2) as found:
        if found is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")
        west, east = (found(0.0, 0.5, 0.0, ((0.0, 1.0), (x, 0.5))) for x in (-1.5, 1.0))
    teal = [np.argwhere(each[:, :, 1:].astype(int).min(2) > each[:, :, 0].astype(int) + 50) for each in (west, east)]
    assert all(len(each) > 30 for each in teal)
    assert teal[0][:, 1].mean() + 30 < teal[1][:, 1].mean()


@pytest.mark.long
def test_it_is_hidden_by_what_stands_before_it(shoot: Shoot):
    assert len(robot(shoot(0.0, -1.5, 0.0))) == 0  # within the sofa, whose seat is higher


@pytest.mark.usefixtures("render")
def test_worlds_stand_side_by_side_with_something_to_see_in_each():
    file = render_sheet_png([apartment(), apartment(name="world-2-1")])
    assert file is not None
    sheet = decoded(file)
    left, right = sheet[:, : sheet.shape[1] // 2], sheet[:, sheet.shape[1] // 2 :]
    assert left.std() > 10.0
    assert right.std() > 10.0
    assert sheet.shape[1] > sheet.shape[0]


@pytest.mark.long
@pytest.mark.usefixtures("render")
def test_no_more_worlds_are_read_than_asked_for():
    def one_more() -> Iterator[World]:
        yield apartment()
        pytest.fail("a world was read that is not rendered")

    assert render_sheet_png(one_more(), most=1) is not None


@pytest.mark.long
@pytest.mark.usefixtures("render")
def test_a_caption_is_written_below_its_picture():
    with open_renderer(200, 150, 1) as render:
        assert render is not None
        plain, named = render(apartment(), ()), render(apartment(), ("world-1-1", "36.0 m2"))
    text = named[-2 * CAPTION_LINE :]
    assert plain.shape == named.shape
    assert np.all(text[:, -8:] == 255)
    for line in (text[:CAPTION_LINE], text[CAPTION_LINE:]):
        assert line.min() < 100


def test_a_sheet_without_worlds_is_refused():
    with pytest.raises(ValueError, match="needs a world"):
        render_sheet_png([])
