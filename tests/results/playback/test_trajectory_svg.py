"""The paths of failures on a plan."""

from xml.etree import ElementTree as ET

import pytest

from tasks.results.playback.plan_drawings import failure_map_svg
from tests.factories.episodes import collided, passed

SVG = "{http://www.w3.org/2000/svg}"
PLAN = (
    '<svg xmlns="http://www.w3.org/2000/svg" data-units-per-m="100" data-origin-x="500" data-origin-y="300">'
    "<rect/></svg>\n"
)


def test_a_path_is_drawn_to_scale_with_y_up():
    result = collided(0).model_copy(update={"trajectory": ((0.0, 0.0, 0.0, 0.0), (1.0, 2.0, 1.0, 0.0))})
    root = ET.fromstring(failure_map_svg(PLAN, [("b/0", result)]))  # noqa: S314 - our own document
    [line] = root.iter(f"{SVG}polyline")
    assert line.get("points") == "500.0,300.0 700.0,200.0"


def test_the_tooltip_names_job_and_reason():
    root = ET.fromstring(failure_map_svg(PLAN, [("b/<7>\x00", collided(7))]))  # noqa: S314 - our own document
    assert [title.text for title in root.iter(f"{SVG}title")] == ["b/<7>\ufffd: collision"]


def test_an_episode_without_a_trajectory_draws_nothing():
    root = ET.fromstring(failure_map_svg(PLAN, [("b/0", passed(0))]))  # noqa: S314 - our own document
    assert not list(root.iter(f"{SVG}polyline"))


def test_a_plan_without_a_scale_is_refused():
    with pytest.raises(ValueError, match="export it again"):
        failure_map_svg('<svg xmlns="http://www.w3.org/2000/svg"></svg>', [])
