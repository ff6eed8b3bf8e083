"""How many episodes a rule needs: as many pass, and a few less do not."""

import pytest

from specs.pipeline.gate_section import Gate, SuccessRate
from tasks.results.gate.gate import judge
from tasks.results.gate.rules.rule import Completeness, GateMaterial
from tasks.results.statistics.intervals import paired_difference, quantile_interval
from tasks.results.statistics.power.episodes_needed import (
    episodes_needed,
    episodes_needed_at_any_look,
    episodes_needed_for_quantile,
    pairs_needed,
)
from tests.factories.episodes import batch, counted


def verdict(n: int, bar: float, rate: float, *, sequential: bool = False) -> str:
    successes = int(rate * n + 1e-9)
    material = GateMaterial(counted(batch(successes, n - successes)), Completeness(sequential=sequential))
    return judge(Gate(successRate=SuccessRate(atLeast=bar)), material).verdict


@pytest.mark.parametrize(("bar", "rate"), [(0.9, 1.0), (0.9, 0.95), (0.5, 0.7), (0.99, 0.999), (0.0, 0.5)])
def test_the_episodes_needed_pass_and_a_few_less_do_not(bar: float, rate: float):
    needed = episodes_needed(bar, 0.95, rate)
    assert needed is not None
    assert verdict(needed, bar, rate) == "PASS"
    assert all(verdict(n, bar, rate) != "PASS" for n in range(max(1, needed - 5), needed))


@pytest.mark.parametrize(("bar", "rate"), [(1.0, 1.0), (0.9, 0.9), (0.9, 0.5)])
def test_no_number_of_episodes_shows_what_is_not_so(bar: float, rate: float):
    assert episodes_needed(bar, 0.95, rate) is None


@pytest.mark.parametrize(("bar", "rate"), [(0.9, 1.0), (0.9, 0.98), (0.5, 0.7)])
def test_more_episodes_are_needed_if_one_may_look_at_any_time(bar: float, rate: float):
    needed, looked = episodes_needed(bar, 0.95, rate), episodes_needed_at_any_look(bar, 0.95, rate)
    assert needed is not None
    assert looked is not None
    assert needed < looked < 4 * needed
    assert verdict(looked, bar, rate, sequential=True) == "PASS"
    assert verdict(looked - 1, bar, rate, sequential=True) != "PASS"
    assert episodes_needed_at_any_look(0.9, 0.95, 0.9) is None


@pytest.mark.parametrize(("margin", "disagreeing"), [(0.02, 0.0), (0.02, 0.04), (0.05, 0.1)])
def test_the_pairs_needed_show_that_an_equal_version_is_no_worse(margin: float, disagreeing: float):
    needed = pairs_needed(margin, 0.95, disagreeing)
    assert needed is not None
    each = int(disagreeing * needed / 2)
    assert paired_difference(each, each, needed, 0.95).lower >= -margin
    fewer = needed // 2
    each = int(disagreeing * fewer / 2)
    assert paired_difference(each, each, fewer, 0.95).lower < -margin
    assert pairs_needed(0.0, 0.95, disagreeing) is None


@pytest.mark.parametrize(("quantile", "at_least"), [(0.05, True), (0.95, False), (0.5, True), (0.3, False)])
def test_the_episodes_needed_bound_a_quantile_that_none_is_beyond(quantile: float, at_least: bool):  # noqa: FBT001
    needed = episodes_needed_for_quantile(quantile, 0.95, 0.0, at_least=at_least)
    assert needed is not None

    def bounded(n: int) -> bool:
        interval = quantile_interval([1.0] * n, quantile, 0.95)
        return (interval.lower if at_least else interval.upper) == 1.0

    assert bounded(needed)
    assert not bounded(needed - 1)


def test_no_number_of_episodes_bounds_a_quantile_that_too_many_are_beyond():
    assert episodes_needed_for_quantile(0.05, 0.95, 0.05, at_least=True) is None
    assert episodes_needed_for_quantile(0.05, 0.95, 0.02, at_least=True) is not None
