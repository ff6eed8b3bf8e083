"""Drawings on the plan of a world: an episode as an animation, and the paths of failures."""

import base64
import io
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from specs.bundle_files import DepthCameraDeclaration
from specs.data.people import PERSON_RADIUS_M
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.results.playback.plan_drawings import failure_map_svg, plan_page, replay_svg
from tasks.results.playback.playback import CameraFilm
from tests.factories.episodes import collided, passed
from tests.factories.playbacks import DECK, WHEEL, boxed_playback, playback, seen_playback
from tests.factories.worlds import apartment

SVG = "{http://www.w3.org/2000/svg}"
WORLD = apartment()
PLAN = floor_plan_svg(WORLD)
PAGE = plan_page(PLAN)


@pytest.fixture(scope="module")
def root() -> ET.Element:
    return ET.fromstring(replay_svg(PLAN, playback(), WORLD.footprint))  # noqa: S314 - our own document


def _of(root: ET.Element, name: str) -> ET.Element:
    return next(each for each in root.iter() if each.get("class") == name)


def _moves(parent: ET.Element) -> list[ET.Element]:
    return [each for each in parent if each.tag in {f"{SVG}animate", f"{SVG}animateTransform"}]


def test_the_robot_goes_the_way_in_real_time(root: ET.Element):
    (move,) = _moves(_of(_of(root, "moving"), "robot"))
    values = [tuple(map(float, each.split())) for each in move.get("values", "").split(";")]
    times = [float(each) * float(move.get("dur", "").rstrip("s")) for each in move.get("keyTimes", "").split(";")]
    assert values[0] == pytest.approx(PAGE.at((0.0, 0.5)), abs=0.06)
    assert values[10] == pytest.approx(PAGE.at((0.5, 0.5)), abs=0.06)
    assert times[10] == pytest.approx(0.5, abs=1e-3)
    assert values[-2:] == [values[20]] * 2  # it rests where it ended


def test_beyond_half_a_turn_it_turns_on_and_not_back(root: ET.Element):
    robot = _of(_of(root, "moving"), "robot")
    (turn,) = _moves(robot[0])
    turns = np.array([float(each) for each in turn.get("values", "").split(";")])
    assert np.abs(np.diff(turns)).max() < 4.0


def test_the_robot_is_drawn_as_its_parts_and_without_any_as_a_disc(root: ET.Element):
    (disc,) = _of(_of(root, "moving"), "robot").iter(f"{SVG}circle")
    assert float(disc.get("r", "")) == pytest.approx(0.2 * PAGE.units_per_m, abs=0.06)
    shaped = ET.fromstring(replay_svg(PLAN, replace(playback(), shape=(WHEEL, DECK)), WORLD.footprint))  # noqa: S314 - our own
    robot = _of(_of(shaped, "moving"), "robot")
    parts = list(robot.iter(f"{SVG}polygon"))
    assert [each.get("fill") for each in parts] == ["rgb(26,26,26)", "rgb(51,102,204)", None, None]
    # What lies below another part is seen by its edge.
    assert parts[2].get("points") == parts[0].get("points")
    assert not list(robot.iter(f"{SVG}circle"))


def test_every_animation_has_a_time_for_each_value_that_never_falls(root: ET.Element):
    moves = [each for each in root.iter() if each.get("keyTimes")]
    assert len({move.get("dur") for move in moves}) == 1
    for move in moves:
        times = [float(each) for each in move.get("keyTimes", "").split(";")]
        assert len(times) == len(move.get("values", "").split(";"))
        assert times[0] == 0.0
        assert times == sorted(times)
        assert times[-1] == 1.0 or move.get("calcMode") == "discrete"


def test_a_contact_is_one_ring_where_it_began(root: ET.Element):
    rings = [each for each in _of(root, "moving").iter() if each.get("class") == "touch"]
    (ring,) = rings
    x, y = PAGE.at((0.5, 0.5))
    assert (float(ring.get("cx", "")), float(ring.get("cy", ""))) == pytest.approx((x, y), abs=0.06)
    assert ring[0].text == "contact after 0.50 s"


def test_the_scan_is_drawn_from_where_the_lidar_is(root: ET.Element):
    scan = _of(root, "scan")
    corner = tuple(map(float, scan.get("points", "").split()[0].split(",")))
    yaw = np.pi - 0.2
    ahead = (1.6 * np.cos(yaw), 0.5 + 1.6 * np.sin(yaw))
    assert corner == pytest.approx(PAGE.at(ahead), abs=0.06)


def test_people_walk_on_the_plan_and_stand_where_they_ended():
    walked = ET.fromstring(replay_svg(PLAN, playback(people=2), WORLD.footprint))  # noqa: S314 - our own document
    people = [each for each in _of(walked, "moving").iter() if each.get("class") == "person"]
    assert len(people) == 2
    across, up = (np.array([float(each) for each in move.get("values", "").split(";")]) for move in _moves(people[1]))
    np.testing.assert_allclose(np.stack([across[10], up[10]]), PAGE.at((0.25, 2.0)), atol=0.06)
    stand = [each for each in _of(walked, "still").iter() if each.get("class") == "person"]
    assert float(stand[0].get("cx", "")) == pytest.approx(PAGE.at((0.5, 1.0))[0], abs=0.06)
    assert float(stand[0].get("r", "")) == pytest.approx(PERSON_RADIUS_M * PAGE.units_per_m, abs=0.06)


def test_a_box_is_on_the_plan_while_it_stands():
    root = ET.fromstring(replay_svg(PLAN, boxed_playback(), WORLD.footprint))  # noqa: S314 - our own document
    first, second = (each for each in _of(root, "moving").iter() if each.get("class") == "box")
    for box, seen in ((first, "visible"), (second, "hidden")):
        values = _moves(box)[0].get("values", "").split(";")
        assert {*values} == {"visible", "hidden"}
        assert values[-1] == seen
        assert values[0] == "hidden"
    assert float(first.get("width", 0)) / float(first.get("height", 0)) == pytest.approx(0.3 / 1.2, rel=0.01)
    (left,) = (each for each in _of(root, "still").iter() if each.get("class") == "box")
    assert left.get("x") == first.get("x")


def test_other_robots_drive_on_the_plan_and_stand_where_they_ended():
    driven = ET.fromstring(replay_svg(PLAN, playback(robots=2), WORLD.footprint))  # noqa: S314 - our own document
    others = [each for each in _of(driven, "moving").iter() if each.get("class") == "other"]
    assert len(others) == 2
    across, up = (np.array([float(each) for each in move.get("values", "").split(";")]) for move in _moves(others[1]))
    np.testing.assert_allclose(np.stack([across[10], up[10]]), PAGE.at((0.5, -2.0)), atol=0.06)
    stand = [each for each in _of(driven, "still").iter() if each.get("class") == "other"]
    assert float(stand[0].get("cx", "")) == pytest.approx(PAGE.at((1.0, -1.0))[0], abs=0.06)
    assert float(stand[0].get("r", "")) == pytest.approx(0.2 * PAGE.units_per_m, abs=0.06)


def test_who_wants_less_motion_sees_the_end_and_all_marks_without_animation(root: ET.Element):
    still = _of(root, "still")
    assert not [each for each in still.iter() if _moves(each)]
    assert {each.get("class") for each in still.iter()} >= {"robot", "touch", "reached", "clock", "told"}
    style = next(each.text or "" for each in _of(root, "replay") if each.tag == f"{SVG}style")
    assert "@media (prefers-reduced-motion:reduce){.replay .moving{display:none}" in style


def test_it_needs_nothing_from_elsewhere(root: ET.Element):
    text = ET.tostring(root, encoding="unicode")
    assert "<script" not in text
    assert text.count("http") == text.count("http://www.w3.org/2000/svg")


def test_a_long_episode_is_shown_faster_and_stays_small():
    drawing = replay_svg(PLAN, playback(20 * 600 + 1, rays=360), WORLD.footprint)
    assert len(drawing) < 1_500_000
    assert "collision, 20 times as fast" in drawing
    root = ET.fromstring(drawing)  # noqa: S314 - our own document
    (bar,) = _moves(_of(root, "past"))
    length_s = float(bar.get("dur", "").rstrip("s"))
    assert length_s == pytest.approx(31.5)
    shares = [float(each) for each in bar.get("keyTimes", "").split(";")]
    assert shares[-2] * length_s == pytest.approx(30.0, abs=1e-2)


def test_a_robot_without_lidar_and_one_that_never_moved_are_drawn():
    assert 'class="scan"' not in replay_svg(PLAN, playback(rays=0), WORLD.footprint)
    assert "0.00 s" in replay_svg(PLAN, playback(1), WORLD.footprint)


def test_what_the_robot_saw_is_shown_beside_the_plan_while_it_saw_it():
    drawing = replay_svg(PLAN, seen_playback(), WORLD.footprint)
    root = ET.fromstring(drawing)  # noqa: S314 - our own document
    images = list(_of(root, "moving").iter(f"{SVG}image"))
    assert len(images) == 2 * 3
    assert {float(each.get("x", "")) for each in images} == {PAGE.width}
    assert float((root.get("viewBox") or "").split()[2]) == float(root.get("width", "")) > PAGE.width + 300
    moves = [move for each in images[:3] for move in _moves(each)]
    length_s = float(moves[0].get("dur", "").rstrip("s"))
    begun = [[float(each) * length_s for each in move.get("keyTimes", "").split(";")] for move in moves]
    assert begun == [
        pytest.approx([0.0, 0.4], abs=1e-4),
        pytest.approx([0.0, 0.4, 0.8], abs=1e-4),
        pytest.approx([0.0, 0.8], abs=1e-4),
    ]
    near = [_decoded(each)[0, 0].astype(int).sum() for each in images[:3]]
    assert near[0] < near[1] < near[2]  # nearer is lighter
    assert len({tuple(_decoded(each)[0, -1]) for each in images[:3]}) == 1  # nothing is seen there in any
    grey = [_decoded(each).mean() for each in images[3:]]
    assert grey == pytest.approx([40, 120, 200], abs=3)
    assert [each.get("href") for each in _of(root, "still").iter(f"{SVG}image")] == [
        images[2].get("href"),
        images[5].get("href"),
    ]


def test_a_camera_of_many_pixels_and_pictures_leaves_a_small_drawing():
    rng, count = np.random.default_rng(1), 300
    depth_m = rng.uniform(0.5, 5.0, (1, 480, 640)).astype(np.float32).repeat(count, 0)
    film = CameraFilm(DepthCameraDeclaration(columns=640, rows=480), np.arange(count) / 5, depth_m)
    drawing = replay_svg(PLAN, replace(playback(20 * 60 + 1), depth=film), WORLD.footprint)
    assert 10 < drawing.count("<image") <= 121
    assert len(drawing) < 4_000_000  # noise, which no PNG makes small
    (width,) = {_decoded(each).shape[1] for each in ET.fromstring(drawing).iter(f"{SVG}image")}  # noqa: S314 - our own
    assert width == 160


def _decoded(image: ET.Element) -> np.ndarray:
    body = base64.b64decode(image.get("href", "").partition("base64,")[2])
    return np.asarray(Image.open(io.BytesIO(body)).convert("RGB"))


EMPTY_PLAN = (
    '<svg xmlns="http://www.w3.org/2000/svg" data-units-per-m="100" data-origin-x="500" data-origin-y="300">'
    "<rect/></svg>\n"
)


def test_a_path_is_drawn_to_scale_with_y_up():
    result = collided(0).model_copy(update={"trajectory": ((0.0, 0.0, 0.0, 0.0), (1.0, 2.0, 1.0, 0.0))})
    root = ET.fromstring(failure_map_svg(EMPTY_PLAN, [("b/0", result)]))  # noqa: S314 - our own document
    [line] = root.iter(f"{SVG}polyline")
    assert line.get("points") == "500.0,300.0 700.0,200.0"


def test_the_tooltip_names_job_and_reason():
    root = ET.fromstring(failure_map_svg(EMPTY_PLAN, [("b/<7>\x00", collided(7))]))  # noqa: S314 - our own document
    assert [title.text for title in root.iter(f"{SVG}title")] == ["b/<7>\ufffd: collision"]


def test_an_episode_without_a_trajectory_draws_nothing():
    root = ET.fromstring(failure_map_svg(EMPTY_PLAN, [("b/0", passed(0))]))  # noqa: S314 - our own document
    assert not list(root.iter(f"{SVG}polyline"))


def test_a_plan_without_a_scale_is_refused():
    with pytest.raises(ValueError, match="export it again"):
        failure_map_svg('<svg xmlns="http://www.w3.org/2000/svg"></svg>', [])
