"""The audit's tables are simulated: an engine's error is found, and chaos is not blamed."""

import numpy as np
import pytest

from benchmarks.simulation.audit import Population, alarms, audited, drawn_batch, passes_share


@pytest.mark.parametrize(("passes", "chaotic"), [(0.95, 0.1), (0.5, 0.5)])
def test_a_chaotic_batch_of_a_good_engine_is_hardly_ever_suspect(passes: float, chaotic: float):
    rng = np.random.default_rng(3)
    blamed = [alarms(audited(drawn_batch(rng, Population(passes, chaotic)), 32, str(k))) for k in range(60)]
    assert sum(blamed) <= 4


def test_false_passes_are_found_and_chaos_beside_them_hides_them_not():
    rng = np.random.default_rng(4)
    found = [
        alarms(audited(drawn_batch(rng, Population(0.95, chaotic=0.05, false_passes=0.2)), 32, str(k)))
        for k in range(30)
    ]
    assert sum(found) >= 24


def test_the_weighted_share_is_that_of_the_batch_in_the_mean():
    batch = drawn_batch(np.random.default_rng(5), Population(0.9, chaotic=0.1, false_passes=0.1))
    wrong = float((batch.rows & ~batch.drives[0]).sum() / batch.rows.sum())
    seen = [passes_share(audited(batch, 32, str(k))).rate or 0.0 for k in range(150)]
    assert np.mean(seen) == pytest.approx(wrong, abs=0.02)
