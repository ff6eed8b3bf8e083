"""Failures that are unlike each other: which are chosen first, how many others stand behind each, and what is changed
of them to meet others: each place is as likely as another."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics.distinct_failures import FailureTraits, counts_of_nearest, farthest_first, near_failures
from tasks.results.statistics.particles import Particles


def traits(count: int, seed: int = 0, *, kinds: int = 3) -> FailureTraits:
    """Returns failures in three clusters, far from each other in every part."""
    generator = np.random.default_rng(seed)
    kind = np.arange(count) % kinds
    return FailureTraits(
        reason=kind,
        world=kind,
        seed=kind,
        place_m=kind[:, None] * 10.0 + generator.random((count, 2)) * 0.1,
        numbers=kind[:, None] / kinds + generator.random((count, 2)) * 0.01,
        choices=kind[:, None],
    )


def test_one_of_each_kind_comes_before_a_second_of_any():
    first = farthest_first(traits(90), 3)
    assert first[0] == 0
    assert {each % 3 for each in first} == {0, 1, 2}


def test_each_failure_is_counted_with_the_nearest_that_is_chosen():
    found = traits(91)
    assert counts_of_nearest(found, farthest_first(found, 3)) == [31, 30, 30]
    assert counts_of_nearest(traits(0), []) == []


def test_failures_that_do_not_differ_are_one():
    same = traits(5, kinds=1)
    same = same._replace(place_m=np.zeros((5, 2)), numbers=np.zeros((5, 2)))
    assert farthest_first(same, 5) == [0]
    assert farthest_first(traits(0), 5) == []


def test_each_part_tells_failures_apart():
    same = traits(2, kinds=1)._replace(place_m=np.zeros((2, 2)), numbers=np.zeros((2, 2)))
    other = np.array([0, 1])
    assert same.apart(0).tolist() == [0.0, 0.0]
    for changed, apart in (
        (same._replace(reason=other), 1.0),
        (same._replace(world=other), 3.0),  # places and seeds of two worlds have nothing in common
        (same._replace(seed=other), 1.0),
        (same._replace(place_m=np.array([[0.0, 0.0], [0.3, 0.4]])), 0.5),
        (same._replace(place_m=np.array([[0.0, 0.0], [30.0, 40.0]])), 1.0),
        (same._replace(numbers=np.array([[0.0, 0.0], [0.0, 0.6]])), 0.2),
        (same._replace(choices=other[:, None]), 1.0 / 3.0),
    ):
        assert changed.apart(0)[1] == pytest.approx(apart)


@given(count=st.integers(1, 60), most=st.integers(1, 20), seed=st.integers(0, 99))
def test_more_that_are_asked_for_begin_with_the_same_and_all_stand_behind_one(count: int, most: int, seed: int):
    found = traits(count, seed)
    chosen = farthest_first(found, most)
    assert len(chosen) == len({*chosen}) == min(count, most)
    assert farthest_first(found, most + 1)[: len(chosen)] == chosen
    assert sum(counts_of_nearest(found, chosen)) == count


SEEDS = (2**32, 2**32)


def met(count: int, numbers: int = 2) -> tuple[Particles, FailureTraits]:
    """Returns failures in cells of their own, all but the last one at one place."""
    random = np.random.default_rng(3)
    smooth, drawn = random.standard_normal((count, numbers)), np.full((count, 2), 0.25)
    drawn[-1] = 0.75
    place_m = np.zeros((count, 2))
    place_m[-1] = 3.0
    traits = FailureTraits(
        reason=np.zeros(count, np.int64),
        world=np.zeros(count, np.int64),
        seed=np.arange(count),
        place_m=place_m,
        numbers=np.linspace(0.0, 1.0, count)[:, None] * np.ones(numbers),
        choices=np.zeros((count, 0), np.int64),
    )
    return Particles(smooth, drawn), traits


def test_a_place_is_tried_as_often_as_another_however_many_failures_it_has():
    near = near_failures(*met(9), SEEDS, count=4_000, seed=0, generation=0)
    kept = (near.drawn == 0.75).all(1)  # of which an eighth have one of both drawn anew
    assert kept[np.arange(4_000) % 8 != 7].mean() == pytest.approx(0.5, abs=0.03)


def test_of_each_eight_three_change_numbers_a_little_two_one_two_some_and_one_something_else():
    particles, traits = met(2, numbers=8)
    near = near_failures(particles, traits, SEEDS, count=800, seed=0, generation=0)
    first = (near.drawn < 0.5).all(1)
    parents = particles.smooth[np.where(first, 0, 1)]
    changed = (near.smooth != parents).sum(1)
    kind = np.arange(800) % 8
    little, one, some, other = (np.isin(kind, each) for each in ([0, 3, 6], [1, 4], [2, 5], [7]))
    assert changed[little].tolist() == [8] * 300
    assert changed[one].tolist() == [1] * 200
    assert changed[some].mean() == pytest.approx(4.0, abs=0.3)
    others = np.isin(near.drawn, [0.25, 0.75]).sum(1)
    assert others[other].tolist() == [1] * 100
    assert others[~other].tolist() == [2] * 700
    assert np.isin(near.smooth[other], particles.smooth).all()


def test_a_little_is_of_some_sizes_and_as_large_as_half_a_plain_draw():
    near = near_failures(*met(1, numbers=8), SEEDS, count=800, seed=0, generation=0).smooth[::8]
    moved = np.sort((near - met(1, numbers=8)[0].smooth).std(1))
    assert moved[0] < 0.05
    assert 0.3 < moved[-1] < 1.0


def test_a_number_that_varies_where_failures_are_at_one_place_is_drawn_anew_less_often():
    particles, traits = met(64)
    numbers = np.stack([np.linspace(0.0, 1.0, 64), np.full(64, 0.5)], axis=1)
    same = traits._replace(place_m=np.zeros((64, 2)), numbers=numbers)
    near = near_failures(particles, same, SEEDS, count=1_600, seed=0, generation=0)
    one = near.smooth[np.isin(np.arange(1_600) % 8, [1, 4])]
    varied, decides = (~np.isin(one[:, at], particles.smooth[:, at]) for at in (0, 1))
    assert (varied ^ decides).all()
    assert varied.mean() == pytest.approx(0.1 / 1.1, abs=0.04)


def test_without_numbers_one_of_the_others_is_drawn_anew():
    near = near_failures(*met(3, numbers=0), SEEDS, count=50, seed=0, generation=0)
    assert near.smooth.shape == (50, 0)
    assert (np.isin(near.drawn, [0.25, 0.75]).sum(1) == 1).all()


def test_another_choice_world_or_seed_is_never_the_one_that_failed_and_each_other_is_as_likely():
    near = near_failures(*met(1, numbers=0), (4, 2**32), count=900, seed=0, generation=0)
    world = (near.drawn[:, 0] * 4).astype(int)
    kept = world == 3
    assert (near.drawn[kept, 1] != 0.75).all()
    assert (near.drawn[~kept, 1] == 0.75).all()
    assert kept.mean() == pytest.approx(0.5, abs=0.06)
    assert [np.mean(world[~kept] == each) for each in range(3)] == pytest.approx([1 / 3] * 3, abs=0.07)


def test_in_one_world_alone_the_seed_is_another():
    near = near_failures(*met(1, numbers=0), (1, 2**32), count=40, seed=0, generation=0)
    assert (near.drawn[:, 0] == 0.75).all()
    assert len(np.unique(near.drawn[:, 1])) == 40


def test_of_a_cell_the_failure_that_was_met_first_is_changed():
    particles, traits = met(3)
    same = traits._replace(numbers=np.full((3, 2), 0.55), place_m=np.zeros((3, 2)))
    near = near_failures(particles, same, SEEDS, count=40, seed=0, generation=0)
    assert np.isin(near.smooth[np.arange(40) % 8 == 7], particles.smooth[0]).all()


def test_what_is_drawn_follows_from_the_seed_and_the_generation():
    first, again = (near_failures(*met(5), SEEDS, count=20, seed=1, generation=2) for _ in range(2))
    assert all(map(np.array_equal, first, again))
    for other in (
        near_failures(*met(5), SEEDS, count=20, seed=0, generation=2),
        near_failures(*met(5), SEEDS, count=20, seed=1, generation=3),
    ):
        assert not np.array_equal(first.smooth, other.smooth)


def test_a_robot_that_is_farther_away_than_whole_numbers_go_is_in_a_cell():
    _, traits = met(2)
    place_m = np.array([[1e30, 0.0], [-1e300, 0.0]])
    cells = traits._replace(place_m=place_m).cells()
    assert len(np.unique(cells[:, :4], axis=0)) == 2
