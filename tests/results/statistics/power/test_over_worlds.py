"""Worlds for a power: near what drawing worlds and asking the gate's own interval gives."""

import numpy as np
import pytest

from tasks.results.statistics.over_worlds import rate_over_worlds, rates_shown
from tasks.results.statistics.power import world_needs


@pytest.mark.parametrize(("rate", "icc", "per_world", "worlds"), [(0.95, 0.1, 8, 48), (0.98, 0.05, 8, 28)])
def test_the_power_of_worlds_is_near_that_of_the_gates_interval(rate: float, icc: float, per_world: int, worlds: int):
    rng, total, draws = np.random.default_rng(3), 1.0 / icc - 1.0, 400
    chances = rng.beta(rate * total, (1.0 - rate) * total, (draws, worlds))
    shown, _ = rates_shown(rng.binomial(per_world, chances), np.full(worlds, per_world), 0.9, 0.95)
    needs = world_needs(0.9, 0.95, rate, icc=icc, per_world=per_world, there=worlds)
    assert needs is not None
    assert needs.power == pytest.approx(shown.mean(), abs=0.08)


def test_worlds_that_are_more_alike_inside_are_needed_in_greater_number():
    needs = [world_needs(0.9, 0.95, 0.95, icc=icc, per_world=8, there=48) for icc in (0.0, 0.1)]
    assert needs[0] is not None
    assert needs[1] is not None
    assert needs[0].for_80 < needs[0].for_90
    assert needs[0].for_80 < needs[1].for_80
    assert needs[0].power > needs[1].power


def test_worlds_without_a_failure_are_enough_when_the_gates_interval_says_so():
    needs = world_needs(0.9, 0.95, 1.0, icc=0.05, per_world=8, there=48)
    assert needs is not None
    assert rate_over_worlds([8] * needs.for_90, [8] * needs.for_90, 0.95).lower >= 0.9
    assert rate_over_worlds([8] * (needs.for_90 - 1), [8] * (needs.for_90 - 1), 0.95).lower < 0.9


def test_what_is_not_above_the_bar_is_shown_by_no_number_of_worlds():
    assert world_needs(0.9, 0.95, 0.9, icc=0.05, per_world=8, there=48) is None
