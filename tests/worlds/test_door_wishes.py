"""Doorway sets: names beat types, types beat the whole home, and a pair is met from either end."""

import pytest
from pydantic import JsonValue

from tasks.worlds.resolved_template import Opening, resolve_template
from tests.worlds.templates import doorway, room, template

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
