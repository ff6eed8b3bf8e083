"""Groups are made for a room of a type and an area, and what they need is seen in their frame."""

import math

import numpy as np
import pytest

from tasks.worlds.furnishing.groups import FurnitureGroup, Member, RoomContext, Zone, front_zone
from tasks.worlds.furnishing.scene import open_scene
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.geometry import Box, bounding_box
from tests.worlds.rooms import ROBOT_M, empty_scene
from tests.worlds.templates import MODEL_TYPES


def setting(
    seed: int = 1, width_m: float = 5.0, listed: tuple[str, ...] | None = None, radius_m: float = ROBOT_M
) -> RoomContext:
    scene = open_scene(empty_scene(width_m, 4.0).floor, (), radius_m)
    return RoomContext(np.random.default_rng(seed), "Living", scene, listed, 5.0)


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_sizes_are_those_of_the_catalogue(kind: str) -> None:
    for seed in range(10):
        drawn = setting(seed)
        for size in (drawn.size(kind), *drawn.sizes(kind), drawn.smallest(kind)):
            assert CATALOGUE[kind].holds(size)


def test_sizes_to_try_become_smaller() -> None:
    for seed in range(10):
        widths = [size[0] for size in setting(seed, width_m=7.0).sizes("Sofas")]
        assert widths == sorted(widths, reverse=True)


def test_a_room_without_a_list_allows_everything() -> None:
    assert setting().allows("Baths")
    assert not setting(listed=("Beds",)).allows("Baths")


def test_what_people_pass_a_large_robot_passes_too() -> None:
    assert setting(radius_m=0.25).front_m("Sofas") == CATALOGUE["Sofas"].front_m
    assert setting(radius_m=0.45).front_m("Sofas") >= 2 * 0.45
    assert setting(radius_m=0.45).front_m("Nightstands") == CATALOGUE["Nightstands"].front_m


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
