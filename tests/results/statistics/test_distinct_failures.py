"""Failures that are unlike each other: which are chosen first, and how many others stand behind each."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics.distinct_failures import FailureTraits, counts_of_nearest, farthest_first


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
