"""What in a template has no effect is told, with its place and the reason."""

import pytest
from pydantic import JsonValue

from specs.template.body import TemplateBody
from tasks.worlds.unused_sets import unused_sets
from tests.docs.template_page import EXAMPLES, example
from tests.worlds.templates import doorway, furniture, materials, room, template

ROOMS = (room("Kitchen", "Kitchen"), room("Hall", "Hallway"))
KITCHEN: JsonValue = {"RoomNames": ["Kitchen"]}


@pytest.mark.parametrize("name", EXAMPLES)
def test_all_of_an_example_has_an_effect(name: str):
    assert unused_sets(example(name)) == []
    assert unused_sets(TemplateBody()) == []


def test_a_name_that_no_room_has_is_told_with_the_one_that_is_meant():
    sets = (furniture({"RoomNames": ["Kithcen", "Attic"]}, ["Fridges"]),)
    assert unused_sets(template(*ROOMS, arrangements=sets)) == [
        'Interior.Furniture.FurnitureArrangements[0].TargetSet: no room is called "Kithcen"; did you mean "Kitchen"?',
        'Interior.Furniture.FurnitureArrangements[0].TargetSet: no room is called "Attic"; there are Kitchen, Hall',
    ]


def test_a_set_that_comes_second_for_its_rooms_is_told():
    (line,) = unused_sets(template(*ROOMS, walls=(materials(KITCHEN, "Tiles"), materials(KITCHEN, "Brick"))))
    assert line.startswith("Interior.Walls.MaterialSets[1].TargetSet: sets that name its rooms")


def test_a_set_for_types_that_there_are_not_is_told():
    (line,) = unused_sets(template(*ROOMS, flooring=(materials({"RoomTypes": ["Closet"]}, "Tiles"),)))
    assert line == "Interior.Flooring.MaterialSets[0].TargetSet: no room is of type Closet"


def test_a_material_that_there_is_not_is_told_with_those_that_there_are():
    (line,) = unused_sets(template(*ROOMS, flooring=(materials(KITCHEN, "tiles", "Marble"),)))
    assert 'Flooring.MaterialSets[0].SampleSet: no material is called "Marble"; there are Carpet' in line


def test_an_end_of_a_doorway_that_no_room_has_is_told():
    pair: JsonValue = {"From": KITCHEN, "To": {"RoomNames": ["hall"]}}
    (line,) = unused_sets(template(*ROOMS, version="2", doorways=(doorway(pair, 50),)))
    assert line.startswith(
        'Interior.Doorways.DoorwaySets[0].TargetSet.To: no room is called "hall"; did you mean "Hall"?'
    )
