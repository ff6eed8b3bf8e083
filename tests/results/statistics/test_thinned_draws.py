"""Thinned draws: no bias whatever the surrogate says, as many as were asked for, and intervals that cover."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtri

from tasks.results.statistics.particles import Particles, Scores, Space, plain_particles
from tasks.results.statistics.thinned_draws import Lot, Thinned, counted, draws_for, thinned

Score = Callable[[Particles], Scores]
_SPACE = Space(2, 2, (3,))
_RARE = 0.02
_DRAWS = 5_000


def score(each: Particles) -> Scores:
    """Returns the distance from a plane, beyond which lies a share of all draws."""
    return -ndtri(_RARE) - each.smooth.sum(1) / np.sqrt(2.0)


def misleading(each: Particles) -> Scores:
    """Returns a score that says of the other side that it fails."""
    return -ndtri(_RARE) + each.smooth.sum(1) / np.sqrt(2.0)


def lot(number: int, teacher: Score = score, size: int = 400, before: Thinned | None = None) -> Thinned:
    """Returns a lot whose surrogate has learned from plain draws what some score says of them."""
    known = plain_particles(_SPACE, 1_000, number, (7,))
    going = thinned(Lot(_SPACE, number, 1, _DRAWS, size), (known, teacher(known)), 0.5, before)
    particles = next(going)
    with pytest.raises(StopIteration) as ended:
        going.send(score(particles))
    answer = ended.value.value
    assert isinstance(answer, Thinned)
    return answer


def test_as_many_are_simulated_as_were_asked_for():
    for size in (200, 399, 400):
        assert size - 1 <= len(lot(1, size=size).scores) <= size


def test_those_that_may_fail_are_simulated_more_often_and_count_less():
    answer = lot(1)
    assert answer.failing.mean() > 10.0 * _RARE
    assert answer.weights[answer.failing].mean() < answer.weights[~answer.failing].mean() / 3.0


def test_a_lot_is_of_plain_draws():
    whole = Lot(_SPACE, 3, 1, 40_000, 100)
    places = np.array([0, 5, 16_383, 16_384, 39_999])
    taken = whole.take(places)
    assert taken.smooth.tolist()[:3] == whole.part(0).smooth[[0, 5, 16_383]].tolist()
    assert taken.drawn.tolist()[3] == whole.part(16_384).drawn[0].tolist()
    assert len(taken.smooth) == 5


@pytest.mark.parametrize("teacher", [score, misleading])
def test_a_surrogate_that_is_wrong_brings_no_bias(teacher: Score):
    estimates = np.array([counted([lot(number, teacher)], 0.95).estimate for number in range(20)])
    assert abs(estimates.mean() - _RARE) < 3.0 * estimates.std() / np.sqrt(len(estimates))


def test_intervals_of_a_good_surrogate_cover_and_are_narrow():
    answers = [counted([lot(number)], 0.95) for number in range(20)]
    assert np.mean([each.interval.lower <= _RARE <= each.interval.upper for each in answers]) >= 0.85
    plain = np.sqrt(_RARE * (1.0 - _RARE) / 400)
    assert np.std([each.estimate for each in answers]) < plain / 2.0


def test_lots_count_by_how_many_were_simulated():
    few, many = lot(1, size=200), lot(2, size=400)
    one, other = (counted([each], 0.95).estimate for each in (few, many))
    share = len(few.scores) / (len(few.scores) + len(many.scores))
    assert counted([few, many], 0.95).estimate == pytest.approx(share * one + (1.0 - share) * other)


def test_the_design_of_a_lot_is_the_one_that_would_have_been_best_before():
    answer = lot(1)
    assert 0 <= answer.best_design < 3
    worse = answer._replace(designs=np.stack([answer.designs[answer.best_design], 1.0 / (1e-3 + answer.designs[0])]))
    assert worse.best_design == 0


def test_without_a_failure_nothing_is_known():
    none = lot(1)._replace(scores=np.ones(len(lot(1).scores)))
    assert (none.scatter(100), counted([none], 0.95).estimate) == (np.inf, 0.0)
    assert (counted([none], 0.95).interval.lower, counted([none], 0.95).interval.upper) == (0.0, 1.0)


def test_a_lot_has_more_draws_the_rarer_a_failure_is_and_none_where_that_would_be_too_many():
    assert draws_for(1e-3) == 400_000
    assert draws_for(1e-3, 6_000) == 500_000
    assert draws_for(1e-4) == 1_000_000
    assert draws_for(1e-6) == 0
