"""All 31 furniture types exist, in the sizes that the norms and the shops know."""

import math
from itertools import pairwise

import pytest

from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import STEP_M
from tests.specs.own_words import robomakers_words
from tests.worlds.templates import MODEL_TYPES


def widths(kind: str) -> set[float]:
    return {width for variant in CATALOGUE[kind].variants for width in variant.sizes[0]}


def test_the_catalogue_holds_exactly_the_types_of_the_template() -> None:
    assert set(CATALOGUE) == set(MODEL_TYPES)
    assert len(robomakers_words([*CATALOGUE])) == 31


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_sizes_come_in_steps_of_five_centimetres(kind: str) -> None:
    for variant in CATALOGUE[kind].variants:
        for extents, (low, high) in zip(
            variant.sizes, (variant.width_m, variant.depth_m, variant.height_m), strict=True
        ):
            assert extents[0] == low
            assert math.isclose(extents[-1], high, abs_tol=1e-9)
            assert all(math.isclose(b - a, STEP_M) for a, b in pairwise(extents))


@pytest.mark.parametrize("area_m2", [1.0, 10.0, 60.0, 300.0])
@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_every_type_has_a_usual_size_in_every_room(kind: str, area_m2: float) -> None:
    assert CATALOGUE[kind].usual(area_m2)


def test_kitchen_units_are_modules_of_the_norm() -> None:
    for kind in ("Ovens", "DishWashers"):
        assert all(math.isclose(round(width * 10), width * 10) for width in (0.6, 1.2))
        assert min(widths(kind)) == 0.6
        assert {variant.depth_m for variant in CATALOGUE[kind].variants} == {(0.6, 0.6)}


def test_beds_are_mattresses_of_usual_width_in_a_frame() -> None:
    assert {round(width - 0.1, 2) for width in widths("Beds")} == {0.9, 1.4, 1.6, 1.8}


def test_large_beds_are_for_large_rooms() -> None:
    small, large = (max(variant.width_m[1] for variant in CATALOGUE["Beds"].usual(area)) for area in (10.0, 20.0))
    assert (small, large) == (1.0, 1.9)
