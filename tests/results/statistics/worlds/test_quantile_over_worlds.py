"""The interval of a quantile in worlds like these."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.results.statistics.intervals import Interval, quantile_interval
from tasks.results.statistics.over_worlds import quantile_over_worlds, rate_over_worlds

worlds = st.lists(st.lists(st.integers(0, 40).map(float), min_size=1, max_size=8), min_size=5, max_size=8)
few = settings(max_examples=10)


@given(worlds, st.sampled_from([0.4, 0.5, 0.6]))
@few
def test_from_above_it_is_that_from_below_turned_over(values: list[list[float]], quantile: float):
    found = quantile_over_worlds(values, quantile, 0.9)
    turned = quantile_over_worlds([[-value for value in each] for each in values], 1.0 - quantile, 0.9)
    assert (turned.lower, turned.upper) == (-found.upper, -found.lower)
    assert found.lower <= found.upper


@given(worlds)
@few
def test_below_the_lower_bound_the_share_of_values_is_shown_to_be_too_small(values: list[list[float]]):
    lower = quantile_over_worlds(values, 0.5, 0.9).lower
    if lower > -math.inf:
        below = [sum(value < lower for value in each) for each in values]
        assert rate_over_worlds(below, [len(each) for each in values], 0.9).upper <= 0.5 + 1e-9


@given(worlds, st.integers(0, 7))
@few
def test_what_is_not_known_on_a_side_never_moves_the_bound_of_that_side_inwards(values: list[list[float]], which: int):
    unknown = [list(each) for each in values]
    unknown[which % len(values)][0] = -math.inf
    assert quantile_over_worlds(unknown, 0.5, 0.9).upper <= quantile_over_worlds(values, 0.5, 0.9).upper


def test_worlds_that_differ_leave_more_doubt_than_their_values_alone():
    random = np.random.default_rng(1)
    values = random.normal(size=(8, 1)) + 0.3 * random.normal(size=(8, 24))
    found, plain = (
        quantile_over_worlds(values.tolist(), 0.5, 0.95),
        quantile_interval(values.ravel().tolist(), 0.5, 0.95),
    )
    assert found.lower < plain.lower < plain.upper < found.upper


def test_a_tail_that_fewer_than_two_worlds_have_is_refused():
    values = np.random.default_rng(1).normal(size=(16, 24)).tolist()
    assert quantile_over_worlds(values, 0.05, 0.95).lower == -math.inf
    assert quantile_over_worlds(values, 0.95, 0.95).upper == math.inf
    assert quantile_over_worlds(values[:1], 0.5, 0.95) == Interval(lower=-math.inf, upper=math.inf)
    assert quantile_over_worlds([[], []], 0.5, 0.95) == Interval(lower=-math.inf, upper=math.inf)


@pytest.mark.parametrize("wrong", [(0.0, 0.9), (1.0, 0.9), (0.5, 0.0), (0.5, 1.0)])
def test_numbers_that_are_no_quantile_are_refused(wrong: tuple[float, float]):
    with pytest.raises(ValueError, match="quantile"):
        quantile_over_worlds([[1.0], [2.0]], *wrong)
