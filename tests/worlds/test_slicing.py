"""Slicing trees cut rooms of exact areas, thousands at a time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.worlds.slicing import AREA_PASSES, lay_out, random_trees

WALL_M = 0.12
areas = st.lists(st.floats(10.0, 100.0), min_size=1, max_size=6)
seeds = st.integers(0, 1000)


@settings(max_examples=30, deadline=None)
@given(areas, seeds)
def test_floor_areas_are_exact_between_wall_faces(wished: list[float], seed: int) -> None:
    trees = random_trees(np.random.default_rng(seed), len(wished), np.full(20, 1.3))
    layouts = lay_out(trees, np.array(wished), WALL_M, AREA_PASSES)
    inner = layouts.cells[..., 2:] - layouts.cells[..., :2] - WALL_M
    sensible = (inner > 1.0).all(axis=(1, 2))
    found = inner.prod(axis=2)[sensible]
    np.testing.assert_allclose(found, np.broadcast_to(wished, found.shape), rtol=1e-3)


@settings(max_examples=30, deadline=None)
@given(areas, seeds)
def test_cells_tile_the_rectangle(wished: list[float], seed: int) -> None:
    trees = random_trees(np.random.default_rng(seed), len(wished), np.full(10, 0.8))
    cells = lay_out(trees, np.array(wished), WALL_M, passes=1).cells
    low, high = cells[..., :2], cells[..., 2:]
    whole = high.max(axis=1) - low.min(axis=1)
    np.testing.assert_allclose((high - low).prod(axis=2).sum(axis=1), whole.prod(axis=1))
    np.testing.assert_allclose(whole[:, 0] / whole[:, 1], 0.8)
    overlap = np.minimum(high[:, :, None], high[:, None]) - np.maximum(low[:, :, None], low[:, None])
    shared = np.clip(overlap, 0, None).prod(axis=-1) * ~np.eye(len(wished), dtype=bool)
    assert shared.max() < 1e-9


def test_a_tree_is_laid_out_the_same_alone_and_among_others() -> None:
    trees = random_trees(np.random.default_rng(3), 5, np.linspace(0.5, 2.0, 50))
    wished = np.array([10.0, 20.0, 30.0, 15.0, 12.0])
    among = lay_out(trees, wished, WALL_M, passes=3)
    alone = lay_out(trees[np.array([17])], wished, WALL_M, passes=3)
    np.testing.assert_array_equal(among.cells[17], alone.cells[0])
    np.testing.assert_array_equal(among.cuts[17], alone.cuts[0])


def test_every_cut_separates_rooms_along_its_whole_length() -> None:
    trees = random_trees(np.random.default_rng(4), 4, np.ones(30))
    layouts = lay_out(trees, np.array([10.0, 20.0, 30.0, 15.0]), WALL_M, passes=2)
    for cells, cuts, vertical in zip(layouts.cells, layouts.cuts, layouts.vertical, strict=True):
        for (at, start, end), runs_along_y in zip(cuts, vertical, strict=True):
            axis = 0 if runs_along_y else 1
            behind = cells[np.isclose(cells[:, axis + 2], at)]
            length = sum(max(0.0, min(end, cell[3 - axis]) - max(start, cell[1 - axis])) for cell in behind)
            assert np.isclose(length, end - start)
