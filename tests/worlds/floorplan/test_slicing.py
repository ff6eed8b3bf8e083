"""Slicing plans are all found, once, with exact areas."""

from math import factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Bool, Float

from tasks.worlds.floorplan.slicing import Shape, labelings, lay_out, shapes

AREAS = np.array([10.0, 21.0, 34.0, 15.0, 12.0, 27.0])


def cells(shape: Shape, lines: Float[np.ndarray, "lines labelings"]) -> Float[np.ndarray, "places 4 labelings"]:
    return lines[shape.sides]


def drawings(rooms: int) -> list[Bool[np.ndarray, "2 rooms rooms"]]:
    """Returns every plan of rooms of different sizes: which room is wholly left of which, and below which."""
    found: list[Bool[np.ndarray, "2 rooms rooms"]] = []
    for shape in shapes(rooms):
        order = labelings(shape)
        drawn = np.take_along_axis(
            cells(shape, lay_out(shape, AREAS[order])), np.argsort(order, axis=0)[:, None], axis=0
        )
        before = drawn[:, None, 2:] <= drawn[None, :, :2] + 1e-9
        found += list(before.transpose(3, 2, 0, 1))
    return found


def images(plan: Bool[np.ndarray, "2 rooms rooms"]) -> set[bytes]:
    """Returns a plan and its mirror images."""
    across, along = plan
    return {np.stack([x, y]).tobytes() for x in (across, across.T) for y in (along, along.T)}


@pytest.mark.parametrize(("rooms", "plans"), [(1, 1), (2, 2), (3, 6), (4, 22), (5, 90)])
def test_with_mirror_images_there_are_as_many_plans_as_schroeder_counted(rooms: int, plans: int) -> None:
    every = set[bytes]().union(*map(images, drawings(rooms)))
    assert len(every) == plans * factorial(rooms)


@pytest.mark.parametrize("rooms", [2, 3, 4, 5])
def test_no_plan_is_the_same_as_another_or_its_mirror_image(rooms: int) -> None:
    plans = drawings(rooms)
    assert len({frozenset(images(plan)) for plan in plans}) == len(plans)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(1.0, 300.0), min_size=1, max_size=6), st.integers(0, 10_000))
def test_areas_are_exact(wished: list[float], pick: int) -> None:
    shape = shapes(len(wished))[pick % len(shapes(len(wished)))]
    areas = np.array(wished)[labelings(shape)]
    low, high = np.split(cells(shape, lay_out(shape, areas)), 2, axis=1)
    np.testing.assert_allclose((high - low).prod(axis=1), areas, rtol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(1.0, 300.0), min_size=2, max_size=6), st.integers(0, 10_000))
def test_places_tile_the_square(wished: list[float], pick: int) -> None:
    shape = shapes(len(wished))[pick % len(shapes(len(wished)))]
    low, high = np.split(cells(shape, lay_out(shape, np.array(wished)[labelings(shape)])), 2, axis=1)
    side = np.sqrt(sum(wished))
    assert low.min() == 0.0
    np.testing.assert_allclose(high.max(axis=0), side)
    overlap = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    shared = np.clip(overlap, 0.0, None).prod(axis=2) * ~np.eye(len(wished), dtype=bool)[:, :, None]
    assert shared.max() < 1e-9 * side * side


@pytest.mark.parametrize("rooms", [3, 5])
def test_places_that_touch_along_a_wall_face_each_other(rooms: int) -> None:
    for shape in shapes(rooms):
        low, high = np.split(cells(shape, lay_out(shape, AREAS[labelings(shape)])), 2, axis=1)
        overlap = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
        touching = (np.abs(overlap.min(axis=2)) < 1e-9) & (overlap.max(axis=2) > 1e-6)
        assert not (touching.any(axis=2) & ~shape.faces()).any()


def test_every_line_lies_between_two_places() -> None:
    for shape in shapes(5):
        inner = np.arange(4, 8)
        assert np.isin(inner, shape.sides[:, :2]).all()
        assert np.isin(inner, shape.sides[:, 2:]).all()
