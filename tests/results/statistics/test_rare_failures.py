"""Rare failures: estimates without bias, intervals that cover, and the same numbers wherever a search is taken up."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from tasks.results.statistics import rare_failures, thinned_draws
from tasks.results.statistics.intervals import clopper_pearson
from tasks.results.statistics.particles import Particles, Scores, Space
from tasks.results.statistics.populations import FAILED, next_level
from tasks.results.statistics.rare_failures import (
    Estimated,
    FailureProbability,
    failure_probability,
    scatter_interval,
)
from tasks.results.statistics.thinned_draws import Counted, Thinned, counted

Score = Callable[[Particles], Scores]
_SMOOTH = 4
_WORLDS = 6
# Failures that are so rare are counted by thinned draws, of which fewer are needed than of rarer ones.
_NOT_SO_RARE = 3e-3


def plane(rare: float) -> Score:
    """Returns the distance from a plane, beyond which lies a share of all draws: the analytic limit state."""
    return lambda each: -ndtri(rare) - each.smooth.sum(1) / np.sqrt(each.smooth.shape[1])


def atoms(rare: float) -> Score:
    """Returns the same in steps of one half, so that many draws have one score."""

    def score(each: Particles) -> Scores:
        exact = plane(rare)(each)
        return np.where(exact < 0.0, FAILED, np.ceil(2.0 * exact) / 2.0)

    return score


def jumps(rare: float) -> Score:
    """Returns scores that stay at 0.2 beyond the plane; there one in twenty seeds fails at once."""

    def score(each: Particles) -> Scores:
        exact = plane(20.0 * rare)(each)
        return np.where((exact < 0.0) & (each.drawn[:, 0] < 0.05), FAILED, np.maximum(exact, 0.2))

    return score


def modes(rare: float) -> Score:
    """Returns the distance from three planes that face away from each other; the third has a tenth of all failures."""
    first, second, third = -ndtri(np.array([0.6, 0.3, 0.1]) * rare)

    def score(each: Particles) -> Scores:
        x, y, z, t = each.smooth.T
        return np.min([first - x, second + y, third - (z - t) / np.sqrt(2.0)], axis=0)

    return score


def worlds(rare: float) -> Score:
    """Returns scores to which worlds and seeds contribute as much as what is smooth."""
    shifts = 0.3 * np.arange(_WORLDS)
    low, high = 0.0, 9.0
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if ndtr(-middle - shifts).mean() > rare else (low, middle)

    def score(each: Particles) -> Scores:
        world = np.floor(_WORLDS * each.drawn[:, 0])
        noise = np.sqrt(0.3) * ndtri(each.drawn[:, 1]) + np.sqrt(0.7) * each.smooth.sum(1) / np.sqrt(_SMOOTH)
        return low + 0.3 * world - noise

    return score


CASES: dict[str, tuple[Callable[[float], Score], Space]] = {
    "plane": (plane, Space(_SMOOTH, 1)),
    "atoms": (atoms, Space(_SMOOTH, 1)),
    "jumps": (jumps, Space(_SMOOTH, 1)),
    "modes": (modes, Space(_SMOOTH, 1)),
    "worlds": (worlds, Space(_SMOOTH, 2, (_WORLDS,))),
}


def found(
    score: Score, space: Space, *, budget: int = 20_000, seed: int = 0, relative_error: float | None = None
) -> FailureProbability:
    return estimated(score, space, budget=budget, seed=seed, relative_error=relative_error).probability


def estimated(
    score: Score, space: Space, *, budget: int = 20_000, seed: int = 0, relative_error: float | None = None
) -> Estimated:
    going = failure_probability(space, budget=budget, confidence=0.95, seed=seed, relative_error=relative_error)
    particles = next(going)
    while True:
        try:
            particles = going.send(score(particles))
        except StopIteration as end:
            return end.value


def seeds(rare: float) -> Score:
    """Returns scores that a seed alone decides, so that nobody can tell which draws may fail."""
    return lambda each: each.drawn[:, -1] - rare


@pytest.mark.parametrize(
    ("make", "space", "rare", "method"),
    [
        (worlds, Space(_SMOOTH, 2, (_WORLDS,)), _NOT_SO_RARE, "thinned"),
        (seeds, Space(0, 2), 1e-3, "splitting"),
        (worlds, Space(_SMOOTH, 2, (_WORLDS,)), 0.2, "draws"),
    ],
)
def test_failures_stand_for_the_estimate_of_their_population(
    make: Callable[[float], Score], space: Space, rare: float, method: str
):
    score = make(rare)
    probability, seen = estimated(score, space)
    assert probability.method == method
    of_each = np.bincount(seen.failed_of, seen.weights, seen.populations)
    assert of_each.mean() == pytest.approx(probability.estimate, rel=0.002)
    assert (score(seen.failed) < 0.0).all()
    assert (score(seen.passed) >= 0.0).all()
    assert {*seen.passed_of.tolist()} == {*range(seen.populations)}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_twenty_thousand_episodes_are_enough_for_the_order_of_magnitude_of_one_in_ten_thousand(name: str):
    make, space = CASES[name]
    answer = found(make(1e-4), space)
    assert answer.method in {"thinned", "splitting"}
    assert 0.5e-4 < answer.estimate < 2e-4
    assert answer.interval.lower < answer.estimate < answer.interval.upper
    assert answer.episodes <= 20_000


@pytest.mark.soak
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("rare", [1e-3, 1e-4])
def test_estimates_have_no_bias_and_intervals_cover(name: str, rare: float):
    searches(name, rare, 200, 20_000)


@pytest.mark.long
@pytest.mark.parametrize("name", ["jumps", "modes", "worlds"])
def test_a_dozen_estimates_have_no_bias_that_is_seen_and_ten_intervals_cover(name: str):
    searches(name, 1e-3, 12, 10_000)


def searches(name: str, rare: float, count: int, budget: int) -> None:
    """Searches so many times, each with a seed of its own, and looks at what answers are together."""
    make, space = CASES[name]
    answers = [found(make(rare), space, budget=budget, seed=seed) for seed in range(count)]
    estimates = np.array([each.estimate for each in answers])
    assert abs(estimates.mean() / rare - 1.0) < 3.0 * estimates.std() / rare / np.sqrt(count)
    covering = sum(each.interval.lower <= rare <= each.interval.upper for each in answers)
    assert covering >= 0.93 * count - 1.2  # of a dozen, 2 may miss by chance: 1 in 50 dozens has more


@pytest.mark.long
@pytest.mark.parametrize(("rare", "budget", "gain"), [(1e-3, 10_000, 10.0), (1e-4, 20_000, 20.0)])
def test_plain_draws_need_many_times_as_many_episodes(rare: float, budget: int, gain: float):
    answers = [found(plane(rare), Space(_SMOOTH, 1), budget=budget, seed=seed) for seed in range(8)]
    error = np.std([each.estimate for each in answers]) / rare
    plain = np.sqrt((1.0 - rare) / (rare * budget))
    assert (plain / error) ** 2 > gain


def test_what_lies_within_a_tie_is_one_level():
    steps = np.repeat([1.0, 0.5, 0.0], [60, 30, 10])
    assert next_level(steps, 10) == 0.0
    assert next_level(steps, 20) == 0.5


def test_a_value_of_most_of_a_population_is_no_level():
    assert next_level(np.array([0.3] * 9 + [0.2]), 5) == 0.2
    level = next_level(np.array([0.3] * 9 + [FAILED]), 5)
    assert level is not None
    assert FAILED <= level < 0.0


def test_where_all_are_as_near_there_is_no_step():
    assert next_level(np.full(10, 0.3), 2) is None


def test_a_score_of_zero_is_no_failure():
    on_the_edge = found(lambda each: np.maximum(plane(0.2)(each), 0.0), Space(1, 1), budget=2_000)
    assert on_the_edge.estimate == 0.0


def test_frequent_failures_are_counted_and_it_says_why():
    answer = found(plane(0.05), Space(_SMOOTH, 1))
    assert answer.method == "draws"
    assert answer.why.startswith("by a pilot about 1 in ")  # the answer itself is another number
    assert "so that plain draws come within" in answer.why
    assert answer.interval.lower < 0.05 < answer.interval.upper
    assert answer.episodes == 20_000


def test_a_measure_that_says_nothing_is_left_alone_and_failures_are_counted():
    answer = found(lambda each: np.where(each.drawn[:, 0] < 1e-4, FAILED, 1.0), Space(_SMOOTH, 1))
    assert (answer.method, answer.levels) == ("draws", ())
    assert "the measure does not lead to a failure" in answer.why
    assert answer.interval.lower < 1e-4 < answer.interval.upper


def test_what_never_fails_has_an_upper_bound():
    answer = found(lambda each: 10.0 + plane(0.5)(each) ** 2, Space(_SMOOTH, 1))
    assert answer.method == "draws"
    assert answer.estimate == answer.interval.lower == 0.0
    assert 0.0 < answer.interval.upper < 1e-3


def test_all_populations_that_died_out_leave_the_bound_of_plain_draws():
    plain = clopper_pearson(0, 1000, 0.025)
    assert scatter_interval(np.zeros(12), 0.95, plain) == plain


def test_worlds_and_seeds_alone_may_vary():
    answer = found(lambda each: each.drawn[:, 1] - 1e-3, Space(0, 2))
    assert answer.method == "splitting"
    assert "it can hardly be told which of many draws may" in answer.why
    assert answer.highest >= answer.interval.upper
    assert 5e-4 < answer.estimate < 2e-3


def test_the_lot_that_says_whether_lots_are_better_does_not_count(monkeypatch: pytest.MonkeyPatch):
    """One that met too few failures would be kept, and one that met more would not: that is a bias."""
    asked: list[list[Thinned]] = []

    def spy(lots: Sequence[Thinned], confidence: float) -> Counted:
        asked.append([*lots])
        return counted(lots, confidence)

    monkeypatch.setattr(rare_failures, "counted", spy)
    answer = found(plane(_NOT_SO_RARE), Space(_SMOOTH, 1), budget=10_000)
    assert answer.estimate == counted(asked[-1], 0.95).estimate
    assert not any(asked[0][0] is each for each in asked[-1])


def test_a_budget_that_is_too_large_for_one_lot_of_a_million_draws_is_for_several(monkeypatch: pytest.MonkeyPatch):
    sizes: list[int] = []

    def spy(lots: Sequence[Thinned], confidence: float) -> Counted:
        sizes[:] = [len(each.scores) for each in lots]
        return counted(lots, confidence)

    monkeypatch.setattr(rare_failures, "counted", spy)
    monkeypatch.setattr(thinned_draws, "_MOST_DRAWS", 20_000)
    monkeypatch.setattr(rare_failures, "is_thinnable", lambda _: True)
    answer = found(plane(_NOT_SO_RARE), Space(_SMOOTH, 1), budget=20_000)
    assert answer.method == "thinned"
    assert len(sizes) > 3
    assert max(sizes) <= 2_500
    assert 19_500 < answer.episodes <= 20_000


def test_failures_that_nothing_announces_are_told_of():
    thin, plain = found(plane(_NOT_SO_RARE), Space(_SMOOTH, 1)), found(plane(0.2), Space(_SMOOTH, 1))
    assert f"; at most {thin.highest:.3g} if there are failures that nothing announces" in thin.sentence
    assert thin.highest > thin.interval.upper
    assert plain.highest == plain.interval.upper
    assert "announces" not in plain.sentence


def test_another_seed_gives_another_answer():
    first, other = (found(worlds(_NOT_SO_RARE), Space(_SMOOTH, 2), budget=10_000, seed=seed) for seed in (3, 4))
    assert first.estimate != other.estimate


def test_a_search_that_is_sent_the_scores_that_were_kept_asks_for_the_same_particles():
    kept: list[Scores] = []

    def keep(each: Particles) -> Scores:
        kept.append(worlds(_NOT_SO_RARE)(each))
        return kept[-1]

    whole = found(keep, Space(_SMOOTH, 2), budget=10_000)
    assert whole.method == "thinned"
    left = iter(kept[:-1])
    again = found(lambda each: next(left, worlds(_NOT_SO_RARE)(each)), Space(_SMOOTH, 2), budget=10_000)
    assert again == whole


@pytest.mark.parametrize(("budget", "method"), [(1_000, "draws"), (3_333, "draws"), (20_000, "thinned")])
def test_no_more_is_simulated_than_the_budget_allows(budget: int, method: str):
    asked: list[int] = []

    def count(each: Particles) -> Scores:
        asked.append(len(each.smooth))
        return plane(_NOT_SO_RARE)(each)

    answer = found(count, Space(_SMOOTH, 1), budget=budget)
    assert sum(asked) == answer.episodes <= budget
    assert answer.method == method


def test_too_small_a_budget_is_refused():
    with pytest.raises(ValueError, match="budget: 999: at least 1000"):
        next(failure_probability(Space(1, 1), budget=999, confidence=0.95, seed=0))


@pytest.mark.parametrize(
    ("name", "estimate", "lower", "upper", "episodes"),
    [
        ("plane", 0.000998237824747241, 0.0009132257828339426, 0.001089033632829358, 10_000),
        ("atoms", 0.000992154310922852, 0.0008974105461096518, 0.001094179361420489, 10_000),
        ("jumps", 0.0009934226460333287, 0.000835685374985958, 0.0011722782011396053, 10_000),
        ("modes", 0.0009855154897755237, 0.0009009318599599699, 0.0010759013939167757, 10_000),
        ("worlds", 0.0010254416124472207, 0.0008367270319351926, 0.0013471532649018383, 10_000),
    ],
)
def test_a_seed_has_one_answer_whatever_lanes_simulate_it(
    name: str, estimate: float, lower: float, upper: float, episodes: int
):
    make, space = CASES[name]
    answer = found(make(1e-3), space, budget=10_000, seed=3)
    assert answer.method == "thinned"
    assert answer.estimate == pytest.approx(estimate, rel=1e-9)
    assert (answer.interval.lower, answer.interval.upper) == pytest.approx((lower, upper), rel=1e-9)
    assert answer.episodes == episodes
    assert 0.5e-3 < answer.estimate < 2e-3


def test_a_search_ends_when_its_interval_is_narrow_enough():
    narrow = found(plane(1e-3), Space(_SMOOTH, 1), budget=200_000, relative_error=0.3)
    assert narrow.method == "thinned"
    assert narrow.ended == "narrow"
    assert narrow.episodes < 100_000
    assert (narrow.interval.upper - narrow.interval.lower) / 2.0 <= 0.3 * narrow.estimate
    assert narrow.sentence.endswith("; the interval is as narrow as asked for")


def test_a_search_whose_budget_is_too_small_for_that_spends_it():
    spent = found(plane(1e-3), Space(_SMOOTH, 1), budget=20_000, relative_error=0.05)
    assert spent.ended == "spent"
    assert 19_000 < spent.episodes <= 20_000


def test_plain_draws_end_when_their_interval_is_narrow_enough():
    narrow = found(plane(0.2), Space(_SMOOTH, 1), budget=100_000, relative_error=0.1)
    assert (narrow.method, narrow.ended) == ("draws", "narrow")
    assert narrow.episodes < 20_000


@pytest.mark.parametrize(
    ("name", "searches"),
    [
        pytest.param("jumps", 12, marks=pytest.mark.long),
        *(pytest.param(each, 200, marks=pytest.mark.soak) for each in CASES),
    ],
)
def test_intervals_that_are_narrow_enough_still_cover(name: str, searches: int):
    make, space = CASES[name]
    answers = [found(make(1e-3), space, budget=200_000, seed=seed, relative_error=0.3) for seed in range(searches)]
    assert all(each.ended == "narrow" for each in answers)
    covering = sum(each.interval.lower <= 1e-3 <= each.interval.upper for each in answers)
    assert covering >= 0.93 * searches - 1.2
    assert np.mean([each.estimate for each in answers]) == pytest.approx(1e-3, rel=0.3 / np.sqrt(searches))
