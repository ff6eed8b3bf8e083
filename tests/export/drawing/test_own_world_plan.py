"""The drawings of a building of one's own: prisms, a start that is not the origin, and no rooms."""

from xml.etree import ElementTree as ET

import pytest

from specs.data.world import FloorZone
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.drawing.plan_page import covers, from_above
from tasks.export.picture.contact_sheet import contact_sheet_svg, summary
from tasks.worlds.importer.own_floor import measured
from tests.factories.own_worlds import block, piece, walled_hall, wedge

TURNED = wedge("wedge", (13.0, 7.5), yaw_rad=2.5)
WORLD = measured(walled_hall((6.0, 4.0), [piece("wedge", TURNED)]))
PLAN = floor_plan_svg(WORLD)


def test_a_prism_is_drawn_by_its_corners():
    root = ET.fromstring(PLAN)  # noqa: S314 - our own document
    outlines = [each.get("points", "").split() for each in root.iter("{http://www.w3.org/2000/svg}polygon")]
    assert [len(corners) for corners in outlines] == [4]


def test_zones_are_drawn_with_their_names():
    zone = FloorZone(name="loading <dock>", outline_m=((11.0, 6.0), (13.0, 6.0), (13.0, 8.0)), found=False)
    root = ET.fromstring(floor_plan_svg(WORLD.model_copy(update={"zones": (zone,)})))  # noqa: S314 - our own document
    assert [each.text for each in root.iter("{http://www.w3.org/2000/svg}title")].count("loading <dock>: 2.0 m²") == 1


ROOFED = WORLD.model_copy(
    update={"furniture": (*WORLD.furniture, piece("roof", wedge("roof", (12.0, 7.0), low_m=9.0)))}
)


def test_no_picture_from_above_shows_a_roof():
    assert "roof" not in floor_plan_svg(ROOFED)
    assert contact_sheet_svg([ROOFED], title="hall") == contact_sheet_svg([WORLD], title="hall")


def test_a_contact_sheet_has_zones_with_their_names():
    zone = FloorZone(name="dock", outline_m=((11.0, 6.0), (14.0, 6.0), (14.0, 8.0)), found=True)
    sheet = contact_sheet_svg([WORLD.model_copy(update={"zones": (zone,)})], title="hall")
    assert ">dock</text>" in sheet
    assert sheet.count("stroke-dasharray=") == 1


def test_the_start_is_drawn_where_it_is():
    assert "Start of the robot: (11, 6); 0.975 m around it is free" in PLAN


def test_a_plan_without_rooms_says_what_it_was_made_from():
    assert "free floor 2" in PLAN
    assert "hall.world" in PLAN
    assert "mean area error" not in PLAN
    assert "the floor within reach of a robot of" in summary([WORLD], 1)


@pytest.mark.parametrize(("local", "is_below"), [((0.0, 0.0), True), ((0.45, 0.35), False), ((-0.45, -0.35), True)])
def test_what_a_prism_covers_is_its_outline(local: tuple[float, float], *, is_below: bool):
    assert covers(wedge("wedge", (1.0, 2.0)), 1.0 + local[0], 2.0 + local[1]) is is_below


def test_what_is_below_a_prism_is_not_seen_from_above():
    small = block("small", (13.0, 7.5), (0.2, 0.2)).model_copy(update={"half_extents_m": (0.1, 0.1, 0.1)})
    low = small.model_copy(update={"center_m": (13.0, 7.5, 0.1)})
    assert from_above([low, TURNED]) == [TURNED]
