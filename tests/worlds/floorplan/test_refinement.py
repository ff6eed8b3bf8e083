"""Refinement moves walls to where wishes are met best."""

import numpy as np
import pytest

from tasks.worlds.floorplan.scoring import START_SIDE_M, WALL_M, Demands, Layouts, common_walls, demands_of, score
from tasks.worlds.floorplan.search import _improve_lines, _make_frame, _solve, _terms, propose, refine
from tasks.worlds.resolved_template import ResolvedTemplate
from tests.worlds.briefs import brief, flat, wish


def refined(home: ResolvedTemplate, count: int = 64) -> tuple[Layouts, Demands]:
    demands = demands_of(home)
    return refine(propose(demands, count), demands), demands


def rounded(layouts: Layouts) -> Layouts:
    return layouts.moved(np.round(layouts.lines, 2))


def test_no_layout_gets_worse_and_most_get_better() -> None:
    demands = demands_of(flat())
    proposals = propose(demands, 64)
    before, after = score(rounded(proposals), demands), score(refine(proposals, demands), demands)
    assert (after <= before + 1e-4).all()
    assert (after < before - 0.05).mean() > 0.8


def test_areas_are_kept_within_3_percent() -> None:
    layouts, demands = refined(flat())
    cells = layouts.cells()
    width, height = cells[2:] - cells[:2] - WALL_M
    errors = np.abs(width * height / demands.areas_m2[:, None] - 1.0)[:, score(layouts, demands) < 100.0]
    assert errors.max() < 0.03


def test_lines_are_whole_centimetres_and_the_corner_stays() -> None:
    layouts, _ = refined(flat())
    np.testing.assert_allclose(layouts.lines * 100, np.round(layouts.lines * 100), atol=1e-9)
    assert (layouts.lines[:2] == 0.0).all()


def test_rooms_keep_a_width() -> None:
    for home in (flat(), brief(wish("A", area_m2=10.0), wish("B", area_m2=300.0), wish("C", area_m2=10.0))):
        cells = refined(home)[0].cells()
        assert (cells[2:] - cells[:2] > WALL_M).all()


def test_a_layout_is_refined_the_same_alone_and_among_others() -> None:
    demands = demands_of(flat())
    proposals = propose(demands, 20)
    among, alone = refine(proposals, demands), refine(proposals[np.array([7])], demands)
    np.testing.assert_array_equal(among.lines[:, 7], alone.lines[:, 0])


def test_a_wall_that_is_a_little_short_for_its_doorways_becomes_long_enough() -> None:
    rooms = wish("A", area_m2=15.0), wish("B", area_m2=15.0)
    layouts, demands = refined(brief(*rooms, connections=((0, 1),) * 4), count=2)
    before = common_walls(propose(demands, 2).cells(), *demands.pairs)
    assert before.min() < demands.shared_m[0]
    assert common_walls(layouts.cells(), *demands.pairs).min() >= demands.shared_m[0]


def test_a_connection_that_cannot_be_does_not_cost_areas() -> None:
    # Each with each but for its opposite: no six rectangles have all of these walls.
    pairs = tuple((a, b) for a in range(6) for b in range(a + 1, 6) if (a, b) not in ((0, 1), (2, 3), (4, 5)))
    layouts, demands = refined(brief(*(wish(name, area_m2=20.0) for name in "ABCDEF"), connections=pairs), count=256)
    cells = layouts.cells()[:, :, score(layouts, demands).argmin()]
    floors = (cells[2:] - cells[:2] - WALL_M).prod(axis=0)
    np.testing.assert_allclose(floors, 20.0, rtol=0.03)


def test_a_shape_that_just_misses_the_tolerance_is_brought_within_it() -> None:
    hall = wish("Hall", "Hallway", 16.0, 4.0)
    rooms = (wish(name, "Bedroom") for name in "ABCD")
    home = brief(hall, *rooms, connections=((0, 1), (0, 2), (0, 3), (0, 4)), footprint=2.0)
    layouts, demands = refined(home)
    cells = layouts.cells()[:, 0, score(layouts, demands).argmin()]
    width, height = cells[2:] - cells[:2] - WALL_M
    assert 3.2 <= width / height <= 5.0


def test_a_round_leaves_every_room_half_of_its_width_at_least() -> None:
    equal, unequal = (
        demands_of(brief(*(wish(str(n), area_m2=area) for n, area in enumerate(areas)), footprint=4.0))
        for areas in ((40.0,) * 4, (10.0, 300.0, 10.0, 300.0))
    )
    layouts = propose(equal, 20)
    moved = layouts.moved(_improve_lines(layouts, unequal, _make_frame(layouts, unequal)))
    before, after = (each.cells()[2:] - each.cells()[:2] for each in (layouts, moved))
    assert (after >= 0.499 * before).all()
    assert (after < 0.6 * before).any()


@pytest.mark.parametrize("aspect", [4.0, 0.25])
def test_a_room_that_holds_the_start_gets_as_wide_as_it_needs(aspect: float) -> None:
    layouts, _ = refined(brief(wish("A", area_m2=10.0, aspect=aspect), footprint=aspect))
    cells = layouts.cells()
    assert (cells[2:] - cells[:2]).min() - WALL_M >= START_SIDE_M


def test_a_robot_widens_the_rooms_that_are_too_narrow_for_it() -> None:
    narrow, wide = (
        refined(brief(wish("A", "Hallway", 10.0, 4.0), wish("B", area_m2=40.0), radius_m=radius))[0]
        for radius in (0.25, 0.6)
    )
    assert (narrow.cells()[2:] - narrow.cells()[:2]).min() < (wide.cells()[2:] - wide.cells()[:2]).min() + 1e-9
    assert (wide.cells()[2:] - wide.cells()[:2]).min() - WALL_M >= 1.43


def test_slopes_are_those_of_what_is_missed() -> None:
    demands = demands_of(flat())
    # Lines apart from each other's limits, where what is missed has a slope.
    layouts = propose(demands, 5)
    layouts = layouts.moved(layouts.lines + 0.003 * np.sin(np.arange(layouts.lines.size)).reshape(layouts.lines.shape))
    frame, step_m = _make_frame(layouts, demands), 1e-6
    for line in range(2, len(layouts.lines)):
        up, down = layouts.lines.copy(), layouts.lines.copy()
        up[line] += step_m
        down[line] -= step_m
        high, low = (list(_terms(layouts.moved(lines), demands, frame)) for lines in (up, down))
        for (_, slopes), (after, _), (before, _) in zip(_terms(layouts, demands, frame), high, low, strict=True):
            np.testing.assert_allclose(slopes[:, line], (after - before) / (2 * step_m), rtol=1e-4, atol=1e-4)


def test_systems_are_solved_as_linear_algebra_solves_them() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(9, 5, 7))
    normal = np.einsum("rik,rjk->ijk", rows, rows)
    right = rng.normal(size=(5, 7))
    damped = normal + 1e-3 * np.eye(5)[:, :, None] * (1.0 + normal)
    expected = np.linalg.solve(damped.transpose(2, 0, 1), right.T[:, :, None])[:, :, 0].T
    np.testing.assert_allclose(_solve(normal, right), expected, rtol=1e-9)
