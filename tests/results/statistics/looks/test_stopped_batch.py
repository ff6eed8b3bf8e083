"""What becomes of a batch that may be ended early: the walk's figures are those of simulated batches."""

import numpy as np
import pytest

from tasks.results.statistics.interim_analyses import boundary, chances, looks_of, passes_after


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


def test_a_batch_as_good_as_expected_passes_at_a_look_or_not_at_all():
    looks = looks_of(384, 32)
    assert [passes_after(looks, 0.9, 0.95, rate) for rate in (1.0, 0.95, 0.9)] == [64, 256, None]
