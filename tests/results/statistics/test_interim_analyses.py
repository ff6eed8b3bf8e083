"""Analyses before a batch's end: they err no more often than they may, and end a batch when they can."""

import bisect
import itertools
import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.results.statistics.interim_analyses import (
    Boundary,
    boundary,
    chances,
    chances_between,
    difference_tail,
    inner_interval,
    looks_of,
    nominal_levels,
    paired_interval,
    repeated_interval,
    spent_error,
    tested_shares,
)
from tasks.results.statistics.intervals import Interval, paired_difference

looks = st.lists(st.integers(1, 400), min_size=1, max_size=12, unique=True).map(sorted).map(tuple)


@given(looks, st.floats(0.001, 0.2))
def test_what_may_be_spent_rises_to_alpha(at: tuple[int, ...], alpha: float):
    spent = spent_error(at, alpha)
    assert list(spent) == sorted(spent)
    assert spent[0] > 0.0
    assert spent[-1] == pytest.approx(alpha)


def test_what_may_be_spent_depends_on_the_share_of_the_batch_alone():
    assert spent_error((16, 48, 64), 0.025) == pytest.approx(spent_error((160, 480, 640), 0.025))


@pytest.mark.parametrize("at", [(), (0, 3), (3, 3), (5, 4)])
def test_looks_that_do_not_rise_are_refused(at: tuple[int, ...]):
    with pytest.raises(ValueError, match="rising"):
        spent_error(at, 0.025)


def test_five_equal_looks_that_spend_as_o_brien_and_fleming_have_their_critical_values():
    # Jennison and Turnbull 2000, tables 2.3 and 7.1: alpha .05 two-sided; Lan and DeMets 1983, table 1, for spending.
    normal = NormalDist()
    values = [2.0401 * (5 / look) ** 0.5 for look in range(1, 6)]
    exact = _crossing([5, 10, 15, 20, 25], [1.0 - normal.cdf(value) for value in values])
    assert exact[-1] == pytest.approx(0.025, abs=1e-5)
    levels = nominal_levels([5, 10, 15, 20, 25], exact)
    assert [normal.inv_cdf(1.0 - level) for level in levels] == pytest.approx(values, abs=5e-3)
    spent = [2.0 * (1.0 - normal.cdf(normal.inv_cdf(1.0 - 0.0125) / (look / 5) ** 0.5)) for look in range(1, 6)]
    last = normal.inv_cdf(1.0 - nominal_levels([1, 2, 3, 4, 5], spent)[-1])
    assert last == pytest.approx(2.03, abs=0.01)


def test_one_look_has_all_of_the_error():
    assert nominal_levels([384], [0.025]) == pytest.approx([0.025], rel=1e-6)


def _crossing(looks: list[int], levels: list[float]) -> list[float]:
    """Returns the error spent at each look by critical values, found by what gives them back."""
    spent = list[float]()
    for level in levels:
        low, high = (spent[-1] if spent else 0.0), (spent[-1] if spent else 0.0) + level
        for _ in range(40):
            middle = (low + high) / 2.0
            at = looks[: len(spent) + 1]
            found = nominal_levels(at, [*spent, middle])[-1]
            low, high = (middle, high) if found < level else (low, middle)
        spent.append(high)
    return spent


SCHEDULES = ((40,), (8, 16, 24, 32, 40), (5, 13, 40), (30, 35, 40))
seen = st.sampled_from([(look, at) for at in SCHEDULES for look in at]).flatmap(
    lambda found: st.tuples(st.integers(0, found[0]), st.just(found[0]), st.just(found[1]))
)


def ends(looks: tuple[int, ...], bar: float, confidence: float) -> Boundary:
    """Returns where a batch ends that is judged by its intervals."""

    def passes(look: int) -> int:
        counts = range(look + 1)
        return bisect.bisect_left(counts, bar, key=lambda s: repeated_interval(s, look, looks, confidence).lower)

    def fails(look: int) -> int:
        counts = range(look + 1)
        return bisect.bisect_left(counts, bar, key=lambda s: repeated_interval(s, look, looks, confidence).upper) - 1

    return Boundary(tuple(map(passes, looks)), tuple(map(fails, looks)))


@pytest.mark.parametrize(("looks", "confidence"), [*zip(SCHEDULES, itertools.cycle([0.95, 0.8]))])
def test_the_chance_to_err_is_at_most_half_of_what_confidence_leaves_at_any_bar(
    looks: tuple[int, ...], confidence: float
):
    allowed = (1.0 - confidence) / 2.0
    for bar in (0.1, 0.5, 0.737, 0.85, 0.9, 0.95):
        found = ends(looks, bar, confidence)
        no_pass, no_fail = tuple(look + 1 for look in looks), tuple(-1 for _ in looks)
        assert chances_between(looks, found._replace(fails=no_fail), bar).passes <= allowed
        assert chances_between(looks, found._replace(passes=no_pass), bar).fails <= allowed


def test_most_of_the_error_is_spent_in_a_batch_of_384():
    looks = looks_of(384, 16)
    found = boundary(looks, 0.9, 0.95)
    nothing = tuple(-1 for _ in looks)
    assert 0.022 < chances_between(looks, found._replace(fails=nothing), 0.9).passes <= 0.025


@settings(max_examples=30)
@given(seen)
def test_the_interval_holds_the_estimate_mirrors_what_failed_and_reaches_beyond_the_quick_one(
    found: tuple[int, int, tuple[int, ...]],
):
    successes, n, looks = found
    interval, inner = repeated_interval(successes, n, looks, 0.95), inner_interval(successes, n, looks, 0.95)
    mirrored = repeated_interval(n - successes, n, looks, 0.95)
    assert 0.0 <= interval.lower <= inner.lower <= successes / n <= inner.upper <= interval.upper <= 1.0
    assert (interval.lower, interval.upper) == pytest.approx((1.0 - mirrored.upper, 1.0 - mirrored.lower))


@settings(max_examples=20)
@given(seen)
def test_more_successes_and_less_confidence_never_lower_a_bound(found: tuple[int, int, tuple[int, ...]]):
    successes, n, looks = found
    interval, sure = (repeated_interval(successes, n, looks, confidence) for confidence in (0.9, 0.99))
    assert sure.lower <= interval.lower
    assert interval.upper <= sure.upper
    if successes < n:
        assert repeated_interval(successes + 1, n, looks, 0.9).lower >= interval.lower


@pytest.mark.parametrize("bar", [0.8, 0.9, 0.95])
def test_it_says_of_a_bar_what_the_boundary_says(bar: float):
    looks = looks_of(96, 24)
    assert ends(looks, bar, 0.95) == boundary(looks, bar, 0.95)


def test_shares_that_are_tested_are_the_same_wherever_one_begins():
    everywhere = set((tested_shares(0.0, 1.0) * 1e6).round())
    for lowest, highest in ((0.05, 0.15), (0.0123, 0.0124), (0.898, 0.9013), (0.9002, 0.9004), (0.98999, 0.9902)):
        found = tested_shares(lowest, highest)
        assert set((found * 1e6).round()) <= everywhere
        assert found[0] <= lowest < highest <= found[-1] + 1e-9


def test_with_one_look_it_is_the_exact_interval_of_a_share():
    interval, exact = repeated_interval(36, 40, (40,), 0.95), inner_interval(36, 40, (40,), 0.95)
    assert interval.lower == pytest.approx(exact.lower, abs=5e-4)
    assert interval.upper == pytest.approx(exact.upper, abs=5e-4)


def test_nothing_counted_says_nothing_and_what_is_no_look_is_refused():
    assert repeated_interval(0, 0, (8, 16), 0.95) == Interval(lower=0.0, upper=1.0)
    with pytest.raises(ValueError, match="one of the looks"):
        repeated_interval(3, 9, (8, 16), 0.95)


LOOKS = (16, 32, 48, 64)
pairs = st.sampled_from(LOOKS).flatmap(
    lambda n: st.integers(0, n).flatmap(lambda gains: st.tuples(st.just(gains), st.integers(0, n - gains), st.just(n)))
)


def test_the_tail_is_the_sum_over_all_that_might_have_been_seen():
    gains, losses, n, difference = 3, 1, 9, -0.1
    # The share of losses that is likeliest under the difference, found by trying.
    tried = np.arange(0.1, 0.55, 1e-5)
    likelihood = gains * np.log(np.maximum(tried + difference, 1e-300)) + losses * np.log(tried)
    likelihood += (n - gains - losses) * np.log(np.maximum(1.0 - 2.0 * tried - difference, 1e-300))
    lost = float(tried[np.argmax(likelihood)])
    gained, rest = lost + difference, 1.0 - 2.0 * lost - difference
    exact = sum(
        math.comb(n, up) * math.comb(n - up, down) * gained**up * lost**down * rest ** (n - up - down)
        for up, down in itertools.product(range(n + 1), repeat=2)
        if up + down <= n and up - down >= gains - losses
    )
    assert difference_tail(gains, losses, n, difference) == pytest.approx(exact, rel=1e-3)


def test_without_disagreement_the_tail_is_that_no_loss_was_seen():
    assert difference_tail(0, 0, 50, -0.05) == pytest.approx(0.95**50)


@settings(max_examples=40)
@given(pairs)
def test_the_interval_holds_the_estimate_and_mirrors_what_the_other_version_gains(found: tuple[int, int, int]):
    gains, losses, n = found
    interval, mirrored = paired_interval(gains, losses, n, LOOKS, 0.95), paired_interval(losses, gains, n, LOOKS, 0.95)
    assert -1.0 <= interval.lower <= (gains - losses) / n <= interval.upper <= 1.0
    assert (interval.lower, interval.upper) == (-mirrored.upper, -mirrored.lower)


def test_at_the_end_it_is_wider_than_that_of_one_look_and_not_much():
    interval, alone = paired_interval(4, 3, 64, LOOKS, 0.95), paired_difference(4, 3, 64, 0.95)
    assert interval.lower < alone.lower
    assert interval.lower - alone.lower > -0.05


def test_no_pair_says_nothing_and_what_is_no_look_is_refused():
    assert paired_interval(0, 0, 0, LOOKS, 0.95) == Interval(lower=-1.0, upper=1.0)
    with pytest.raises(ValueError, match="one of the looks"):
        paired_interval(0, 0, 17, LOOKS, 0.95)


@pytest.mark.long
@pytest.mark.parametrize(("margin", "disagreeing"), [(0.05, 0.05), (0.05, 0.1)])
def test_of_versions_that_are_worse_by_the_margin_no_more_than_a_fortieth_is_ever_found_no_worse_or_worse(
    margin: float, disagreeing: float
):
    looks, batches = (48, 96, 144, 192), 4_000
    drawn, better = np.random.default_rng(5).random((batches, looks[-1])), (disagreeing - margin) / 2.0
    gains = np.cumsum(drawn < better, axis=1)
    losses = np.cumsum((drawn >= better) & (drawn < disagreeing), axis=1)
    passed, failed = np.zeros(batches, dtype=bool), np.zeros(batches, dtype=bool)
    for n in looks:
        counted = np.stack([gains[:, n - 1], losses[:, n - 1]], axis=1)
        kinds, kind = np.unique(counted, axis=0, return_inverse=True)
        found = [paired_interval(int(up), int(down), n, looks, 0.95) for up, down in kinds]
        passed |= np.array([each.lower >= -margin for each in found])[kind.ravel()]
        failed |= np.array([each.upper < -margin for each in found])[kind.ravel()]
    assert passed.mean() <= 0.025
    assert failed.mean() <= 0.025


def test_a_batch_is_looked_at_after_each_chunk_and_at_its_end():
    assert looks_of(80, 32) == (32, 64, 80)
    assert looks_of(64, 32) == (32, 64)
    assert looks_of(7, 32) == (7,)


@pytest.mark.parametrize("rate", [0.8, 0.9, 0.96])
def test_simulated_batches_pass_fail_and_end_as_often_as_computed(rate: float):
    looks, batches = looks_of(192, 32), 20_000
    expected, ends = chances(looks, 0.9, 0.95, rate), boundary(looks, 0.9, 0.95)
    counts = np.cumsum(np.random.default_rng(3).binomial(32, rate, (batches, len(looks))), axis=1)
    passed, failed = counts >= np.array(ends.passes), counts <= np.array(ends.fails)
    ended = passed | failed
    first = np.where(ended.any(axis=1), ended.argmax(axis=1), len(looks) - 1)
    rows = np.arange(batches)
    error = 4.0 * 0.5 / batches**0.5
    assert passed[rows, first].mean() == pytest.approx(expected.passes, abs=error)
    assert failed[rows, first].mean() == pytest.approx(expected.fails, abs=error)
    assert np.array(looks)[first].mean() == pytest.approx(expected.episodes, abs=192 * error)


def test_worlds_of_different_difficulty_in_a_shuffled_order_lead_to_no_more_errors():
    # 8 worlds, half of them harder, with the batch's rate at the bar; shuffled, as batches are.
    looks, generator = looks_of(384, 32), np.random.default_rng(11)
    chance = np.repeat([0.8, 0.8, 0.8, 0.8, 1.0, 1.0, 1.0, 1.0], 48)
    drawn = generator.permuted(generator.random((5_000, 384)) < chance, axis=1)
    counts, ends = np.cumsum(drawn, axis=1)[:, np.array(looks) - 1], boundary(looks, 0.9, 0.95)
    passed, failed = (counts >= np.array(ends.passes)).any(axis=1), (counts <= np.array(ends.fails)).any(axis=1)
    assert 0.0 < passed.mean() <= 0.025
    assert 0.0 < failed.mean() <= 0.025
