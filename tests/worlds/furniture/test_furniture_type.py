"""Each piece is made of few primitives inside its size, none in another, with gaps where a lidar sees gaps."""

from itertools import combinations, product

import pytest

from specs.data.world import Furniture, Solid
from tasks.worlds.furnishing.assembly import Look
from tasks.worlds.furniture.catalogue import CATALOGUE, compose
from tasks.worlds.furniture.furniture_type import Size, Style
from tests.worlds.geometry_checks import intersect, polygon, top_m
from tests.worlds.rooms import LOOK, seen_at, standing
from tests.worlds.templates import MODEL_TYPES

STYLES = [Style(*choice) for choice in product((True, False), repeat=2)]
MOST_PARTS = 14
LEAST_HALF_M = 0.005
LIDAR_M = 0.2


def sizes(kind: str) -> list[Size]:
    """Returns the least and the greatest size of each variant."""
    return [
        (extents[0][end], extents[1][end] or extents[0][end], extents[2][end])
        for extents in (variant.sizes for variant in CATALOGUE[kind].variants)
        for end in (0, -1)
    ]


def pieces(kind: str) -> list[tuple[Size, Furniture]]:
    return [(size, standing(kind, size, look=Look(style, LOOK.palette))) for size in sizes(kind) for style in STYLES]


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_a_piece_is_made_of_few_named_parts(kind: str) -> None:
    for _, piece in pieces(kind):
        assert 3 <= len(piece.solids) <= MOST_PARTS
        assert len({solid.name for solid in piece.solids}) == len(piece.solids)


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_parts_are_thick_enough_and_inside_the_piece(kind: str) -> None:
    for (width, depth, height), piece in pieces(kind):
        x, y = piece.center_m
        for solid in piece.solids:
            assert min(solid.half_extents_m) >= LEAST_HALF_M - 1e-9
            outline = polygon(solid)
            assert abs(outline[:, 0] - x).max() <= width / 2 + 1e-6
            assert abs(outline[:, 1] - y).max() <= depth / 2 + 1e-6
            assert solid.center_m[2] - solid.half_extents_m[2] >= -1e-9
        assert max(map(top_m, piece.solids)) == pytest.approx(height, abs=1e-6)


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_no_part_is_inside_another(kind: str) -> None:
    for size, piece in pieces(kind):
        clashes = [(a.name, b.name) for a, b in combinations(piece.solids, 2) if intersect(a, b)]
        assert clashes == [], size


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_something_of_every_piece_stands_on_the_floor(kind: str) -> None:
    for _, piece in pieces(kind):
        assert any(solid.center_m[2] - solid.half_extents_m[2] < 1e-9 for solid in piece.solids)


@pytest.mark.parametrize(("kind", "size"), [("DiningTables", (1.6, 0.9, 0.75)), ("DiningChairs", (0.45, 0.5, 0.9))])
def test_a_lidar_sees_two_legs_and_the_gap_between_them(kind: str, size: Size) -> None:
    hits = seen_at(standing(kind, size), LIDAR_M)
    assert hits.count(True) < 0.25 * len(hits)
    assert sum(b and not a for a, b in zip([False, *hits], hits, strict=False)) == 2


@pytest.mark.parametrize("kind", ["Desks", "ConsoleTables", "CoffeeTables", "FloorLamps", "DeskChairs"])
def test_a_lidar_sees_past_the_legs_of_other_things(kind: str) -> None:
    assert not all(seen_at(standing(kind, sizes(kind)[-1]), LIDAR_M))


@pytest.mark.parametrize("kind", ["Fridges", "Storage", "Baths", "Sofas"])
def test_a_lidar_sees_no_gap_in_what_stands_on_the_floor(kind: str) -> None:
    hits = seen_at(standing(kind, sizes(kind)[0]), LIDAR_M)
    assert hits.count(True) > 0.95 * len(hits)


def test_a_bath_is_hollow() -> None:
    bath = standing("Baths", (1.7, 0.75, 0.75))
    water = part(bath, "water")
    assert top_m(water) < top_m(part(bath, "wall_front")) - 0.1


def test_a_double_bed_has_two_pillows_and_a_single_one() -> None:
    singles, doubles = (
        sum("pillow" in solid.name for solid in standing("Beds", (width, 2.1, 1.0)).solids) for width in (1.0, 1.7)
    )
    assert (singles, doubles) == (1, 2)


def test_worktops_of_a_row_are_level() -> None:
    tops = {top_m(part(standing(kind, sizes(kind)[0]), "worktop")) for kind in ("Ovens", "DishWashers")}
    assert len({round(top, 6) for top in tops}) == 1


def test_compositions_are_made_once() -> None:
    first = compose("Sofas", (2.0, 0.9, 0.85), STYLES[0])
    assert compose("Sofas", (2.0, 0.9, 0.85), STYLES[0]) is first
    assert CATALOGUE["Sofas"].shape((2.0, 0.9, 0.85), STYLES[0]) == first


def part(piece: Furniture, name: str) -> Solid:
    return next(solid for solid in piece.solids if solid.name.endswith(f"_{name}"))
