"""All 31 furniture types exist, and each is made of few primitives inside its size."""

import math
from collections.abc import Callable

import pytest

from specs.world import solids
from tasks.worlds.catalogue import CATALOGUE
from tasks.worlds.compositions import COMPOSITIONS
from tasks.worlds.generate import generate_world
from tasks.worlds.parts import Size, Tints
from tests.worlds.templates import MODEL_TYPES, furniture, room, template

TINTS = Tints((0.5, 0.4, 0.3), (0.4, 0.3, 0.2), (0.2, 0.3, 0.4))


def largest(kind: str) -> Size:
    model = CATALOGUE[kind]
    return model.width_m[1], model.depth_m[1], model.height_m[1]


def smallest(kind: str) -> Size:
    model = CATALOGUE[kind]
    return model.width_m[0], model.depth_m[0], model.height_m[0]


def test_the_catalogue_holds_exactly_the_types_of_the_template() -> None:
    assert set(CATALOGUE) == set(COMPOSITIONS) == set(MODEL_TYPES)
    assert len(CATALOGUE) == 31


@pytest.mark.parametrize("kind", MODEL_TYPES)
@pytest.mark.parametrize("size_of", [smallest, largest])
def test_primitives_are_positive_and_inside_the_piece(kind: str, size_of: Callable[[str], Size]) -> None:
    width, depth, height = size_of(kind)
    parts = COMPOSITIONS[kind]((width, depth, height), TINTS)
    assert 1 <= len(parts) <= 6
    assert len({part.name for part in parts}) == len(parts)
    for part in parts:
        assert min(part.half) > 0
        assert abs(part.center[0]) + part.half[0] <= width / 2 + 1e-9
        assert abs(part.center[1]) + part.half[1] <= depth / 2 + 1e-9
        assert part.center[2] - part.half[2] >= -1e-9
        assert part.center[2] + part.half[2] <= 2.1
        assert math.isclose(part.half[0], part.half[1]) or part.shape == "box"


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_a_room_that_wishes_one_type_gets_it(kind: str) -> None:
    body = template(room("Room", area_m2=30.0), arrangements=(furniture({"RoomNames": ["Room"]}, [kind]),))
    world = generate_world(body, seed=1, generation="wgj-1", floorplan_index=1, interior_index=1)
    assert {piece.model_type for piece in world.furniture} == {kind}
    assert len(solids(world)) <= 100
