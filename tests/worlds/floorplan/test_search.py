"""Refined layouts are better ones, and the layouts that are drawn from are about as good as any."""

from collections import Counter

import numpy as np
import pytest

from tasks.worlds.floorplan.scoring import (
    CONNECTION,
    START_SIDE_M,
    WALL_M,
    Demands,
    Layouts,
    common_walls,
    demands_of,
    score,
    skew,
)
from tasks.worlds.floorplan.search import (
    WorldRejected,
    _improve_lines,
    _make_frame,
    _solve,
    _terms,
    draw_layout,
    good_layouts,
    propose,
    refine,
)
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.resolved_templates import flat, resolved, wish
from tests.worlds.templates import sample


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
    for home in (flat(), resolved(wish("A", area_m2=10.0), wish("B", area_m2=300.0), wish("C", area_m2=10.0))):
        cells = refined(home)[0].cells()
        assert (cells[2:] - cells[:2] > WALL_M).all()


def test_a_layout_is_refined_the_same_alone_and_among_others() -> None:
    demands = demands_of(flat())
    proposals = propose(demands, 20)
    among, alone = refine(proposals, demands), refine(proposals[np.array([7])], demands)
    np.testing.assert_array_equal(among.lines[:, 7], alone.lines[:, 0])


def test_a_wall_that_is_a_little_short_for_its_doorways_becomes_long_enough() -> None:
    rooms = wish("A", area_m2=15.0), wish("B", area_m2=15.0)
    layouts, demands = refined(resolved(*rooms, connections=((0, 1),) * 4), count=2)
    before = common_walls(propose(demands, 2).cells(), *demands.pairs)
    assert before.min() < demands.shared_m[0]
    assert common_walls(layouts.cells(), *demands.pairs).min() >= demands.shared_m[0]


def test_a_connection_that_cannot_be_does_not_cost_areas() -> None:
    # Each with each but for its opposite: no six rectangles have all of these walls.
    pairs = tuple((a, b) for a in range(6) for b in range(a + 1, 6) if (a, b) not in ((0, 1), (2, 3), (4, 5)))
    layouts, demands = refined(resolved(*(wish(name, area_m2=20.0) for name in "ABCDEF"), connections=pairs), count=256)
    cells = layouts.cells()[:, :, score(layouts, demands).argmin()]
    floors = (cells[2:] - cells[:2] - WALL_M).prod(axis=0)
    np.testing.assert_allclose(floors, 20.0, rtol=0.03)


def test_a_shape_that_just_misses_the_tolerance_is_brought_within_it() -> None:
    hall = wish("Hall", "Hallway", 16.0, 4.0)
    rooms = (wish(name, "Bedroom") for name in "ABCD")
    home = resolved(hall, *rooms, connections=((0, 1), (0, 2), (0, 3), (0, 4)), footprint=2.0)
    layouts, demands = refined(home)
    cells = layouts.cells()[:, 0, score(layouts, demands).argmin()]
    width, height = cells[2:] - cells[:2] - WALL_M
    assert 3.2 <= width / height <= 5.0


def test_a_round_leaves_every_room_half_of_its_width_at_least() -> None:
    equal, unequal = (
        demands_of(resolved(*(wish(str(n), area_m2=area) for n, area in enumerate(areas)), footprint=4.0))
        for areas in ((40.0,) * 4, (10.0, 300.0, 10.0, 300.0))
    )
    layouts = propose(equal, 20)
    moved = layouts.moved(_improve_lines(layouts, unequal, _make_frame(layouts, unequal)))
    before, after = (each.cells()[2:] - each.cells()[:2] for each in (layouts, moved))
    assert (after >= 0.499 * before).all()
    assert (after < 0.6 * before).any()


@pytest.mark.parametrize("aspect", [4.0, 0.25])
def test_a_room_that_holds_the_start_gets_as_wide_as_it_needs(aspect: float) -> None:
    layouts, _ = refined(resolved(wish("A", area_m2=10.0, aspect=aspect), footprint=aspect))
    cells = layouts.cells()
    assert (cells[2:] - cells[:2]).min() - WALL_M >= START_SIDE_M


def test_a_robot_widens_the_rooms_that_are_too_narrow_for_it() -> None:
    narrow, wide = (
        refined(resolved(wish("A", "Hallway", 10.0, 4.0), wish("B", area_m2=40.0), radius_m=radius))[0]
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


def drawn(home: ResolvedTemplate, seeds: int) -> list[Layouts]:
    return [draw_layout(np.random.default_rng(seed), home) for seed in range(seeds)]


def deviations(layout: Layouts, home: ResolvedTemplate) -> list[float]:
    """Returns by what share each room misses its wished aspect."""
    cells = layout.cells()[:, :, 0]
    width, height = cells[2:] - cells[:2] - WALL_M
    ratio = width / height / np.array([room.aspect for room in home.rooms])
    return (np.maximum(ratio, 1.0 / ratio) - 1.0).tolist()


def pattern(layout: Layouts) -> bytes:
    """Returns which room is wholly left of which, and below which."""
    cells = layout.cells()[:, :, 0]
    return (cells[2:, :, None] <= cells[:2, None] + 1e-6).tobytes()


def test_rooms_that_fit_side_by_side_get_their_wished_shape() -> None:
    home = resolve_template(sample("two-rooms"))
    assert max(max(deviations(layout, home)) for layout in drawn(home, 20)) <= 0.25


def test_four_default_rooms_are_squares_in_a_square() -> None:
    home = resolve_template(sample("task-06-same-flooring"))
    for layout in drawn(home, 20):
        assert max(deviations(layout, home)) < 0.2
        assert 0.8 < layout.lines[2, 0] / layout.lines[3, 0] < 1.25


def test_all_connections_of_a_flat_are_met_and_no_room_is_far_from_its_shape() -> None:
    home = flat()
    demands = good_layouts(home).demands
    layouts = drawn(home, 50)
    for layout in layouts:
        assert (common_walls(layout.cells(), *demands.pairs)[:, 0] >= demands.shared_m - 1e-6).all()
    assert np.percentile([each for layout in layouts for each in deviations(layout, home)], 95) < 1.0


def test_different_seeds_give_visibly_different_layouts() -> None:
    home = flat()
    layouts = drawn(home, 50)
    assert len({pattern(layout) for layout in layouts}) >= 15
    assert len({layout.lines.tobytes() for layout in layouts}) == 50
    assert max(Counter(map(pattern, layouts)).values()) <= 12


def test_the_same_stream_draws_the_same_layout() -> None:
    good_layouts.cache_clear()
    first = drawn(flat(), 3)
    good_layouts.cache_clear()
    assert [each.lines.tobytes() for each in drawn(flat(), 3)] == [each.lines.tobytes() for each in first]


def test_drawn_layouts_are_whole_centimetres_with_their_corner_at_the_origin() -> None:
    for layout in drawn(flat(), 10):
        np.testing.assert_allclose(layout.lines * 100, np.round(layout.lines * 100), atol=1e-9)
        assert layout.cells()[:2].min(axis=(1, 2)).tolist() == [0.0, 0.0]


def test_mirror_images_and_stretched_layouts_cost_little_more() -> None:
    good = good_layouts(flat())
    for layout in drawn(flat(), 30):
        assert score(layout, good.demands)[0] <= good.scores.max() + 0.5


def test_the_best_layout_is_drawn_most_often() -> None:
    good = good_layouts(flat())
    assert good.chance.sum() == pytest.approx(1.0)
    assert (np.diff(good.chance) <= 1e-12).all()
    assert good.chance[0] > 1.5 * good.chance[-1]
    assert (np.diff(good.scores) >= 0.0).all()


def test_no_layout_is_drawn_that_leaves_out_a_connection_which_others_have() -> None:
    for home in (flat(), resolved(*(wish(n) for n in "ABCDE"), connections=tuple((a, (a + 1) % 5) for a in range(5)))):
        scores = good_layouts(home).scores
        assert scores.max() // CONNECTION == scores.min() // CONNECTION


def test_a_bathroom_is_no_thoroughfare_without_a_wish() -> None:
    home = resolved(wish("Bed", "Bedroom"), wish("Bath", "Bathroom"), wish("Kitchen", "Kitchen"))
    for layout in drawn(home, 10):
        bath, other = np.array([0, 2]), np.array([2, 0])
        assert (common_walls(layout.cells(), bath, other) >= 1.2).all()


@pytest.mark.parametrize(
    ("home", "reason"),
    [
        (resolved(wish("Cupboard", "Closet", 2.0)), r"2\.1 m wide.*Cupboard, has 2 m2; make a room larger"),
        (resolved(wish("Hall", area_m2=30.0), wish("Cupboard", area_m2=1.0)), r"joins them all by doorways of 0\.90 m"),
        (
            resolved(wish("Hall", area_m2=30.0), wish("Cupboard", area_m2=1.0), radius_m=0.6),
            r"radius needs rooms at least 1\.43 m wide, and Cupboard has 1 m2",
        ),
    ],
)
def test_a_brief_without_a_usable_layout_is_refused_with_the_reason(home: ResolvedTemplate, reason: str) -> None:
    with pytest.raises(WorldRejected, match=reason) as caught:
        good_layouts(home)
    assert caught.value.code == "InvalidInput"


def test_the_smallest_six_rooms_are_nearly_squares() -> None:
    home = resolved(*(wish(f"C{n}", "Closet", 10.0) for n in range(6)))
    for layout in drawn(home, 10):
        assert max(deviations(layout, home)) < 0.25


def test_four_equal_squares_are_proposed_as_two_rows() -> None:
    home = resolved(*(wish(name, area_m2=16.0) for name in "ABCD"))
    cells = propose(demands_of(home), 1).cells()[:, :, 0]
    floors = cells[2:] - cells[:2] - WALL_M
    np.testing.assert_allclose(floors, 4.0)


def test_no_more_are_proposed_than_asked_for_or_than_there_are() -> None:
    home = resolved(*(wish(name) for name in "ABCD"))
    assert propose(demands_of(home), 10).lines.shape == (7, 10)
    assert propose(demands_of(home), 1000).lines.shape == (7, 144)


def test_areas_are_nearly_right_and_cells_reach_the_outline() -> None:
    demands = demands_of(flat())
    proposals = propose(demands, 50)
    cells = proposals.cells()
    width, height = cells[2:] - cells[:2] - WALL_M
    np.testing.assert_allclose(width * height, np.tile(demands.areas_m2[:, None], 50), rtol=0.1)
    np.testing.assert_allclose(cells[2:].max(axis=1), proposals.lines[2:4])
    assert (cells[:2].min(axis=1) == 0.0).all()


def test_connected_rooms_lie_side_by_side() -> None:
    demands = demands_of(flat())
    walls = common_walls(propose(demands, 20).cells(), *demands.pairs)
    assert (walls > 0.0).mean() > 0.95


def test_connections_decide_before_shapes() -> None:
    # Five squares of the same size are best as a row of two and one of three, where no room touches all others.
    star = resolved(wish("Hub", "Hallway", 15.0), *(wish(name, area_m2=15.0) for name in "ABCD"))
    wished = resolved(*star.rooms, connections=((0, 1), (0, 2), (0, 3), (0, 4)))
    without, wanted = (propose(demands_of(each), 1).cells() for each in (star, wished))
    hub, others = np.zeros(4, dtype=int), np.arange(1, 5)
    assert (common_walls(without, hub, others) > 1.0).sum() < 4
    assert (common_walls(wanted, hub, others) > 1.0).sum() == 4


def test_the_outline_follows_a_wish_that_is_spelt_out() -> None:
    rooms = [wish(name) for name in "ABCDEF"]
    for aspect in (0.4, 2.5):
        lines = propose(demands_of(resolved(*rooms, footprint=aspect)), 5).lines
        assert (np.abs(skew(lines[2] / lines[3] / aspect)) < 0.6).all()
