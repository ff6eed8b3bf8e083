"""What failures have in common: effects that are known, intervals that hold them, and where nothing can be said."""

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import norm

from tasks.results.statistics.failure_causes import Factor, FailureCauses, _told, failure_causes
from tasks.results.statistics.particles import Particles, Scores, Space
from tests.results.statistics.test_rare_failures import estimated

_WORLDS = 8
_TENTHS = tuple(f"{tenth}" for tenth in range(10))
_WORLD = Factor("world", tuple(f"w{number}" for number in range(_WORLDS)), number=False)
Score = Callable[[Particles], Scores]


def numbers(*names: str) -> list[Factor]:
    return [Factor(name, _TENTHS, number=True) for name in names]


def causes(score: Score, factors: list[Factor], **settings: int) -> FailureCauses:
    """Returns the causes of failures by a score whose last drawn coordinate is a seed."""
    count = sum(each.number for each in factors)
    answer = estimated(score, Space(count, len(factors) - count + 1), **settings)
    return failure_causes(answer.seen, factors, answer.probability.estimate, 0.95)


def by_name(found: FailureCauses) -> dict[str, float]:
    assert found.causes, found.why
    return {each.name: each.share for each in found.causes}


def plane(*slopes: float, rare: float = 1e-3) -> Score:
    """Returns the distance from a plane beyond which lies a share of all draws."""
    slope = np.array(slopes) / np.linalg.norm(slopes)
    return lambda each: float(-norm.ppf(rare)) - each.smooth @ slope


def exact_shares(slopes: tuple[float, ...], rare: float) -> list[float]:
    """Returns the Shapley effects of a plane: what a set carries is a probability of two normal numbers."""
    slope, count = np.array(slopes) / np.linalg.norm(slopes), len(slopes)
    limit = norm.ppf(rare)

    def carried(kept: tuple[int, ...]) -> float:
        alike = min(float((slope[list(kept)] ** 2).sum()), 1.0)
        if alike > 1.0 - 1e-9:
            return rare
        x = np.linspace(-9.0, limit, 20_001)
        return float(np.trapezoid(norm.pdf(x) * ndtr((limit - alike * x) / np.sqrt(1.0 - alike**2)), x))

    effects, orders = np.zeros(count), list(permutations(range(count)))
    for order in orders:
        for length, each in enumerate(order):
            effects[each] += carried(order[: length + 1]) - carried(order[:length])
    return (effects / effects.sum()).tolist()


@pytest.mark.parametrize("slopes", [(1.0, 1.0, 0.0), (2.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("rare", [1e-3, 0.1])
def test_shares_of_a_plane_are_its_shapley_effects(slopes: tuple[float, ...], rare: float):
    found = by_name(causes(plane(*slopes, rare=rare), numbers("a", "b", "c")))
    exact = exact_shares(slopes, rare)
    for name, share in zip("abc", exact, strict=True):
        assert found[name] == pytest.approx(share, abs=0.06), name


def test_a_variable_that_fails_on_both_sides_carries_all():
    found = by_name(causes(lambda each: 3.0 - np.abs(each.smooth[:, 0]), numbers("a", "b")))
    assert found["a"] > 0.95


def test_worlds_carry_their_share_and_those_that_fail_come_first():
    found = causes(
        lambda each: np.where(each.drawn[:, 0] < 2.0 / _WORLDS, 2.3, 4.5) - each.smooth[:, 0],
        [*numbers("a", "b"), _WORLD],
    )
    shares = by_name(found)
    assert shares["b"] < 0.05 < shares["world"]
    worlds = next(each for each in found.causes if each.name == "world")
    assert {each.values for each in worlds.parts[:2]} == {"w0", "w1"}
    assert worlds.parts[0].probability > 20.0 * worlds.parts[2].probability


def test_each_part_of_a_variable_has_its_probability():
    found = causes(lambda each: 2.5 - each.smooth[:, 0], numbers("a", "b"))
    first = next(each for each in found.causes if each.name == "a").parts
    assert [each.values for each in first] == list(_TENTHS)
    exact = 10.0 * ndtr(-2.5)
    assert first[-1].interval.lower < exact < first[-1].interval.upper
    assert first[-1].probability == pytest.approx(exact, rel=0.5)
    assert all(each.probability == 0.0 < each.interval.upper for each in first[:-1])


def test_where_seeds_alone_decide_it_says_so():
    found = causes(lambda each: each.drawn[:, -1] - 0.05, [*numbers("a", "b"), _WORLD])
    assert not found.causes
    assert "seeds" in found.sentence
    assert found.map is None


def test_a_failure_in_a_few_episodes_has_no_causes():
    found = causes(lambda each: 4.5 - each.smooth[:, 0] + each.drawn[:, -1], numbers("a"), budget=1_000)
    assert not found.causes
    assert "too few" in found.why


def test_where_nothing_but_the_seed_varies_it_says_so():
    answer = estimated(lambda each: each.drawn[:, 0] - 0.1, Space(0, 1), budget=1_000)
    assert failure_causes(answer.seen, [], 0.1, 0.95).why == "nothing varies but the seed"


def test_the_map_is_high_where_both_numbers_fail_and_shows_failures_there():
    found = causes(plane(1.0, 1.0, 0.2), numbers("a", "b", "c"))
    assert found.map is not None
    assert {found.map.across, found.map.up} == {"a", "b"}
    heights = np.array(found.map.probability)
    assert heights[-1, -1] == heights.max()
    assert heights[0, 0] == heights.min() < 1e-4
    x, y = np.array(found.map.failures).T
    assert np.median(x) > 0.9
    assert np.median(y) > 0.9
    assert 50 < len(x) <= 200


def test_the_surrogate_is_asked_about_failures_that_it_was_not_fitted_to():
    """Chance alone must not be told: a surrogate that had seen them would tell most."""
    rare = lambda each: each.drawn[:, -1] - 0.05 - 0.01 * each.smooth[:, 0]  # noqa: E731 - as short as the others
    found = causes(rare, numbers("a", "b", "c"))
    assert found.told is None or found.told < 0.75


def test_a_tie_counts_half():
    assert _told(
        np.array([1.0, 2.0]), np.array([0.5, 0.5]), np.array([1.0, 3.0]), np.array([0.5, 0.5])
    ) == pytest.approx(0.375)


@pytest.mark.long
def test_intervals_of_shares_hold_in_most_searches():
    rare = 1e-3
    exact = dict(zip("abc", exact_shares((2.0, 1.0, 0.5), rare), strict=True))
    held: list[bool] = []
    for seed in range(10):
        found = causes(plane(2.0, 1.0, 0.5, rare=rare), numbers("a", "b", "c"), budget=10_000, seed=seed)
        held += [each.interval.lower <= exact[each.name] <= each.interval.upper for each in found.causes]
    assert len(held) == 30
    assert np.mean(held) >= 0.8
