"""The search finds layouts that fulfil the brief."""

import numpy as np
import pytest

from tasks.worlds.brief import Brief, RoomWish, brief_of
from tasks.worlds.rejection import WorldRejected
from tasks.worlds.search import search_layout
from tests.worlds.templates import room, sample, template


def test_rooms_that_fit_side_by_side_get_their_wished_shape() -> None:
    brief = brief_of(sample("two-rooms"))
    for seed in range(5):
        cells = search_layout(np.random.default_rng(seed), brief).cells[0]
        extent = cells[:, 2:] - cells[:, :2] - 0.12
        np.testing.assert_allclose(extent[:, 1] / extent[:, 0], 1.5, rtol=0.25)


def test_layouts_are_whole_centimetres() -> None:
    cells = search_layout(np.random.default_rng(1), brief_of(sample("task-01-list-of-rooms"))).cells
    np.testing.assert_allclose(cells * 100, np.round(cells * 100), atol=1e-9)


def test_a_flat_of_cupboards_is_refused_with_the_reason() -> None:
    tiny = RoomWish("Cupboard", "Closet", 2.0, 1.0, (), (), None, "Moderate")
    brief = Brief(1.0, 3.0, (tiny,), ())
    with pytest.raises(WorldRejected, match=r"2\.1 m wide.*make a room larger") as caught:
        search_layout(np.random.default_rng(0), brief)
    assert caught.value.code == "InvalidInput"


def test_the_smallest_six_rooms_have_a_layout() -> None:
    brief = brief_of(template(*(room(f"C{n}", "Closet", 10.0) for n in range(6))))
    assert search_layout(np.random.default_rng(0), brief).cells.shape == (1, 6, 4)
