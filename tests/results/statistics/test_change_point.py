"""The test of change: it stays quiet while nothing changes, and names the night at which something did."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics.change_point import NIGHTS_A_YEAR, NightCount, _log_gamma, find_changes
from tests.results.trend.histories import counts

nights = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)).map(lambda pair: NightCount(pair[0], sum(pair))))


def clustered(rng: np.random.Generator, rate: float, correlation: float, worlds: int, seeds: int) -> NightCount:
    size = (1 - correlation) / correlation
    passed = rng.binomial(seeds, rng.beta(rate * size, (1 - rate) * size, worlds))
    own = passed.sum() / (worlds * seeds)
    scatter = float(((passed - seeds * own) ** 2 / seeds).sum())
    return NightCount(int(passed.sum()), worlds * seeds, scatter, worlds - 1)


def test_a_drop_is_seen_and_its_first_night_is_named():
    (change,) = find_changes(counts([0.95] * 60 + [0.88] * 20, 384), NIGHTS_A_YEAR)
    assert change.fell
    assert change.earliest <= 60 <= change.latest
    assert abs(change.began - 60) <= 1
    assert 60 <= change.seen <= 64
    assert change.before == pytest.approx(0.95, abs=0.01)
    assert change.after == pytest.approx(0.88, abs=0.03)


def test_a_rate_that_comes_back_is_a_second_change():
    fell, rose = find_changes(counts([0.95] * 40 + [0.85] * 20 + [0.95] * 20, 384), NIGHTS_A_YEAR)
    assert (fell.fell, rose.fell) == (True, False)
    assert rose.earliest <= 60 <= rose.latest


def test_a_level_that_stays_is_told_once():
    assert len(find_changes(counts([0.97] * 40 + [0.9] * 200, 384), NIGHTS_A_YEAR)) == 1


@pytest.mark.parametrize(("rate", "n"), [(0.99, 96), (0.95, 384), (0.5, 24), (1.0, 384)])
def test_nothing_is_seen_more_often_than_once_a_year_while_nothing_changes(rate: float, n: int):
    alarms = sum(len(find_changes(counts([rate] * 365, n, seed), NIGHTS_A_YEAR)) for seed in range(6))
    assert alarms <= 6


def test_worlds_that_are_drawn_anew_make_no_alarms():
    rng = np.random.default_rng(3)
    histories = [[clustered(rng, 0.95, 0.2, 8, 48) for _ in range(365)] for _ in range(6)]
    assert sum(len(find_changes(each, NIGHTS_A_YEAR)) for each in histories) <= 6


def test_nights_of_different_sizes_in_worlds_that_are_drawn_anew_make_no_alarms():
    rng = np.random.default_rng(3)
    sizes = [rng.choice([1, 12, 24], 365) for _ in range(6)]
    histories = [[clustered(rng, 0.95, 0.3, 8, int(seeds)) for seeds in each] for each in sizes]
    assert sum(len(find_changes(each, NIGHTS_A_YEAR)) for each in histories) <= 6


def test_the_worlds_of_the_first_night_differing_hides_no_drop_in_the_same_worlds():
    first, *rest = counts([0.95] * 30 + [0.88] * 10, 384)
    assert find_changes([first._replace(scatter=10.0, freedom=7), *rest], NIGHTS_A_YEAR) == find_changes(
        [first, *rest], NIGHTS_A_YEAR
    )


def test_a_night_with_all_its_failures_in_one_new_world_is_no_alarm():
    quiet = [NightCount(384, 384, 0.0, 7)] * 30
    one_bad_world = NightCount(384 - 30, 384, 7 * (48 - 44.25) ** 2 / 48 + (18 - 44.25) ** 2 / 48, 7)
    assert find_changes([*quiet, one_bad_world], NIGHTS_A_YEAR) == []
    assert find_changes([*quiet, NightCount(384 - 30, 384)], NIGHTS_A_YEAR) != []


def test_two_nights_are_enough_where_they_differ_enough():
    (change,) = find_changes([NightCount(376, 384), NightCount(330, 384)], NIGHTS_A_YEAR)
    assert (change.began, change.seen) == (1, 1)


@pytest.mark.parametrize("history", [[], [NightCount(0, 0)] * 5, [NightCount(3, 4)]])
def test_too_few_nights_say_nothing(history: list[NightCount]):
    assert find_changes(history, NIGHTS_A_YEAR) == []


@given(nights)
def test_nights_without_episodes_change_nothing(history: list[NightCount]):
    there = [night for night in history if night.n]
    with_gaps = [night for each in there for night in (NightCount(0, 0), each)]
    plain, gaps = find_changes(there, 20.0), find_changes(with_gaps, 20.0)
    assert [(2 * each.began + 1, 2 * each.seen + 1) for each in plain] == [(each.began, each.seen) for each in gaps]


@given(nights)
def test_failures_in_place_of_successes_are_the_same_changes_the_other_way_round(history: list[NightCount]):
    turned = [night._replace(successes=night.n - night.successes) for night in history]
    here, there = find_changes(history, 20.0), find_changes(turned, 20.0)
    assert [(each.began, each.seen) for each in here] == [(each.began, each.seen) for each in there]
    assert [each.before for each in here] == pytest.approx([1 - each.before for each in there])


@given(nights, st.integers(0, 60))
def test_an_alarm_does_not_depend_on_what_comes_after_it(history: list[NightCount], cut: int):
    whole = [each for each in find_changes(history, 20.0) if each.seen < cut]
    assert find_changes(history[:cut], 20.0) == whole


@given(nights)
def test_a_change_begins_after_the_one_before_and_not_after_it_is_seen(history: list[NightCount]):
    before = 0
    for each in find_changes(history, 20.0):
        assert before < each.earliest <= each.began <= each.latest <= each.seen
        before = each.began


def test_the_worlds_of_the_first_night_make_the_next_ones_no_more_alike():
    first, second = NightCount(376, 384), NightCount(330, 384, 7 * 10 * 0.08, 7)
    assert find_changes([first, second], 4.0) == find_changes([first._replace(freedom=7), second], 4.0) == []


@given(nights)
def test_the_rate_before_a_change_is_that_since_the_one_before(history: list[NightCount]):
    start = 0
    for each in find_changes(history, 20.0):
        level = history[start : each.began]
        assert each.before == pytest.approx(sum(night.successes for night in level) / sum(night.n for night in level))
        start = each.began


@given(st.floats(0.5, 1e6))
def test_the_gamma_function_is_right(x: float):
    assert float(_log_gamma(np.array(x))) == pytest.approx(math.lgamma(x), rel=1e-11, abs=1e-11)
