"""A template is read with RoboMaker's precedence, and so are its doors."""

import pytest
from pydantic import JsonValue

from specs.template.body import TemplateBody
from tasks.worlds.resolved_template import ConnectionWish, Opening, resolve_template
from tests.worlds.templates import connection, doorway, furniture, materials, room, template


def test_furniture_by_name_beats_by_type_beats_for_all() -> None:
    sets = (
        furniture("Target.All", ["Ottomans"], "Sparse"),
        furniture({"RoomTypes": ["Bedroom"]}, ["Beds"], "Dense"),
        furniture({"RoomNames": ["Mine"]}, [], "Moderate"),
    )
    rooms = (room("Hall", "Hallway"), room("Yours", "Bedroom"), room("Mine", "Bedroom"))
    resolved = resolve_template(template(*rooms, arrangements=sets, version="2"))
    assert [each.furniture for each in resolved.rooms] == [("Ottomans",), ("Beds",), ()]
    assert [each.density for each in resolved.rooms] == ["Sparse", "Dense", "Moderate"]


def test_of_two_sets_at_the_same_level_the_first_wins() -> None:
    sets = (materials({"RoomTypes": ["Living"]}, "Carpet"), materials({"RoomTypes": ["Living"]}, "Tiles"))
    assert resolve_template(template(room("A"), flooring=sets)).rooms[0].floorings == ("Carpet",)


def test_a_set_without_samples_leaves_the_choice_to_the_generator() -> None:
    wish = resolve_template(template(room("A"), arrangements=(furniture({"RoomNames": ["A"]}, None, "Dense"),))).rooms[
        0
    ]
    assert (wish.furniture, wish.density) == (None, "Dense")


def test_an_untargeted_room_is_moderately_furnished() -> None:
    wish = resolve_template(TemplateBody()).rooms[0]
    assert (wish.furniture, wish.density, wish.floorings, wish.walls) == (None, "Moderate", (), ())


def test_aspects_are_width_over_depth() -> None:
    resolved = resolve_template(template(room("A", aspect=(1.0, 2.0)), footprint=(4.0, 1.0)))
    assert (resolved.rooms[0].aspect, resolved.footprint_aspect) == (0.5, 4.0)


def test_connections_name_rooms_by_place_lower_first() -> None:
    resolved = resolve_template(template(room("A"), room("B"), connections=(connection("B", "A", "Opening"),)))
    assert resolved.connections == (ConnectionWish((0, 1), "Opening"),)


def test_doorways_of_version_1_have_no_doors() -> None:
    assert resolve_template(template(room("A"), room("B"))).doors is None


def test_doorways_of_version_2_have_open_doors_unless_it_says_otherwise() -> None:
    doors = resolve_template(template(room("A"), room("B"), version="2")).doors
    assert doors is not None
    assert doors.opening((0, 1)) == 100.0


def test_the_robot_that_a_world_is_made_for_is_part_of_the_brief() -> None:
    assert resolve_template(template(room("A")), 0.4).robot_radius_m == 0.4


KITCHEN, HALL, BEDROOM = 0, 1, 2
ALL: JsonValue = "Target.All"


def named(*names: str) -> JsonValue:
    return {"RoomNames": list(names)}


def typed(*kinds: str) -> JsonValue:
    return {"RoomTypes": list(kinds)}


def between(one: JsonValue, other: JsonValue) -> JsonValue:
    return {"From": one, "To": other}


def opening(pair: tuple[int, int], *sets: tuple[JsonValue, JsonValue]) -> Opening:
    rooms = (room("Kitchen", "Kitchen"), room("Hall", "Hallway"), room("Bed", "Bedroom"))
    body = template(*rooms, version="2", doorways=tuple(doorway(*each) for each in sets))
    doors = resolve_template(body).doors
    assert doors is not None
    return doors.opening(pair)


def test_a_set_for_the_whole_home_holds_for_every_pair() -> None:
    assert opening((KITCHEN, BEDROOM), (ALL, 30)) == 30


@pytest.mark.parametrize("ends", [("Hall", "Kitchen"), ("Kitchen", "Hall")])
def test_a_pair_is_met_from_either_end(ends: tuple[str, str]) -> None:
    assert opening((KITCHEN, HALL), (between(named(ends[0]), named(ends[1])), 40)) == 40


def test_other_pairs_keep_their_open_doors() -> None:
    assert opening((HALL, BEDROOM), (between(named("Kitchen"), named("Hall")), 40)) == 100


def test_names_beat_types_and_types_beat_the_whole_home_in_any_order() -> None:
    sets = (
        (ALL, 10),
        (between(typed("Kitchen"), typed("Hallway")), 20),
        (between(named("Kitchen"), typed("Hallway")), 30),
        (between(named("Kitchen"), named("Hall")), 40),
    )
    for known in range(1, 5):
        assert opening((KITCHEN, HALL), *sets[:known]) == known * 10
        assert opening((KITCHEN, HALL), *reversed(sets[:known])) == known * 10


def test_of_two_sets_at_one_level_the_first_listed_holds() -> None:
    pair = between(named("Kitchen"), named("Hall"))
    assert opening((KITCHEN, HALL), (pair, 70), (pair, 20)) == 70


def test_every_room_of_one_group_is_paired_with_every_room_of_the_other() -> None:
    sets = (between(named("Hall"), named("Kitchen", "Bed")), "Random")
    assert opening((KITCHEN, HALL), sets) == "Random"
    assert opening((HALL, BEDROOM), sets) == "Random"
    assert opening((KITCHEN, BEDROOM), sets) == 100
