"""Thinned draws: no bias whatever the surrogate says, as many as were asked for, and intervals that cover."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtri

from tasks.results.statistics import thinned_draws
from tasks.results.statistics.particles import Particles, Scores, Space, plain_particles
from tasks.results.statistics.thinned_draws import (
    Counted,
    Lot,
    Thinned,
    _chances,
    counted,
    draws_for,
    is_thinnable,
    most_simulated,
    thinned,
)

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


def test_the_last_bits_of_a_surrogate_change_no_chance():
    random = np.random.default_rng(0)
    wanted = random.random(_DRAWS) ** 8
    noise = 1.0 + 1e-13 * random.standard_normal(_DRAWS)
    chances, others = (_chances(each / each.mean(), 400) for each in (wanted, wanted * noise))
    assert chances.tolist() == others.tolist()
    assert chances.sum() == pytest.approx(399.5, rel=1e-5)


def test_of_very_many_that_are_known_some_teach(monkeypatch: pytest.MonkeyPatch):
    known = plain_particles(_SPACE, 3_000, 1, (7,))
    some = known.take(np.arange(0, 3_000, 3))
    asked = Lot(_SPACE, 1, 1, _DRAWS, 400)
    wanted = next(thinned(asked, (some, score(some)), 0.5, None))
    monkeypatch.setattr(thinned_draws, "_MOST_LEARNT", 1_200)
    found = next(thinned(asked, (known, score(known)), 0.5, None))
    assert all(map(np.array_equal, wanted, found))


def test_without_a_failure_the_plain_share_says_how_many_there_are_at_most():
    none = lot(1)._replace(scores=np.ones(len(lot(1).scores)))
    assert none.best_design == 2  # by what failed and what was near
    found = counted([none], 0.95)
    assert (none.scatter(100), found.estimate, found.interval.lower) == (np.inf, 0.0, 0.0)
    # Of 100 plain draws: for a count of none, Fay and Feuer's bound is that of a Poisson law.
    assert found.highest == found.interval.upper == pytest.approx(-np.log(0.025) / (0.25 * len(none.scores)), rel=1e-6)


def test_failures_that_nothing_tells_of_lie_below_the_highest_probability():
    """Half as many again lie where a surrogate that learned from the others says that nothing fails."""
    share = 0.5 * _RARE

    def with_more(each: Particles) -> Scores:
        return np.where(each.drawn[:, -1] < share, -1.0, score(each))

    rare = share + (1.0 - share) * _RARE
    found = list[Counted]()
    for number in range(40):
        known = plain_particles(_SPACE, 1_000, number, (7,))
        going = thinned(Lot(_SPACE, number, 1, _DRAWS, 400), (known, score(known)), 0.5, None)
        particles = next(going)
        with pytest.raises(StopIteration) as ended:
            going.send(with_more(particles))
        found.append(counted([ended.value.value], 0.95))
    assert sum(each.interval.lower <= rare <= each.highest for each in found) >= 38
    assert sum(rare > each.interval.upper for each in found) > 0
    assert all(each.highest >= each.interval.upper for each in found)


def test_a_lot_has_more_draws_the_rarer_a_failure_is_and_is_larger_the_more_fail_of_those():
    assert draws_for(1e-3, 1_000) == 400_000
    assert draws_for(1e-3, 6_000) == 500_000
    assert draws_for(1e-4, 1_000) == draws_for(1e-9, 1_000) == 1_000_000
    assert draws_for(0.5, 9_000) == 18_000
    assert (most_simulated(1e-3), most_simulated(1e-4)) == (12_000, 2_500)
    assert (is_thinnable(1e-4), is_thinnable(1e-6)) == (True, False)
