"""Groups lie in a frame of their own, which turns by quarters."""

import math

import pytest

from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.geometry import Box, bounding_box

BED = Member("Beds", (1.8, 2.0, 1.0))
STAND = Member("Nightstands", (0.4, 0.4, 0.5), (1.1, -0.8), needed=False)
GROUP = FurnitureGroup((BED, STAND), (Zone(Box(-0.9, 1.0, 0.9, 1.6)),))


def test_a_piece_turned_by_a_quarter_swaps_its_extents() -> None:
    assert Member("Sofas", (2.0, 1.0, 0.8), (1.0, 0.0), quarter=1).body == Box(0.5, -1.0, 1.5, 1.0)


def test_a_piece_askew_needs_more_room() -> None:
    body = Member("Ottomans", (1.0, 1.0, 0.4), askew=math.pi / 4).body
    assert body.width == pytest.approx(2**0.5)


def test_a_chair_under_a_table_covers_what_shows() -> None:
    assert Member("DiningChairs", (0.45, 0.5, 0.9), under=0.2).covers == pytest.approx(0.45 * 0.3)


def test_the_boxes_of_a_group_turn_with_it() -> None:
    assert GROUP.turned(0) == [BED.body, STAND.body, GROUP.zones[0].box]
    assert GROUP.turned(1)[2] == (-1.6, -0.9, -1.0, 0.9)
    assert GROUP.turned(2)[2] == (-0.9, -1.6, 0.9, -1.0)
    assert GROUP.turned(3)[2] == (1.0, -0.9, 1.6, 0.9)


def test_a_group_reaches_as_far_as_its_members() -> None:
    needed, everyone = GROUP.reach
    assert needed == BED.body
    assert everyone == bounding_box([BED.body, STAND.body])
    assert GROUP.needed == [0]
    assert GROUP.area == pytest.approx(3.6)


def test_the_floor_before_a_piece_begins_at_its_front() -> None:
    assert front_zone((1.0, 0.6, 2.0), 0.8, 0.1).box == Box(-0.6, 0.3, 0.6, 1.1)
