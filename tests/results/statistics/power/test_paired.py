"""Pairs for a power: as many as Tango's interval needs, counted over all outcomes."""

import numpy as np
import pytest
from scipy.stats import binom

from tasks.results.statistics.intervals import paired_difference
from tasks.results.statistics.power import pair_needs, pair_power

Z = 1.959963984540054


def power(n: int, margin: float, disagreeing: float) -> float:
    total = 0.0
    for unlike in range(int(binom.ppf(1 - 1e-9, n, disagreeing)) + 1):
        passing = (g for g in range(unlike + 1) if paired_difference(g, unlike - g, n, 0.95).lower >= -margin)
        fewest = next(passing, unlike + 1)
        total += binom.pmf(unlike, n, disagreeing) * binom.sf(fewest - 1, unlike, 0.5)
    return float(total)


def test_the_power_is_that_of_the_interval_which_the_gate_uses():
    counted = pair_power(np.array([60, 205]), 0.05, Z, 0.05)
    assert counted == pytest.approx([power(60, 0.05, 0.05), power(205, 0.05, 0.05)], abs=1e-6)


def test_five_points_and_five_percent_that_disagree_need_what_was_measured():
    needs = pair_needs(0.05, 0.95, 0.05, 132)
    assert needs is not None
    assert (needs.for_80, needs.for_90) == (205, 266)  # 258 have 90.4 %, and 265 have 89.8 %
    assert needs.power == pytest.approx(0.58, abs=0.01)


@pytest.mark.parametrize(("margin", "disagreeing"), [(0.02, 0.0), (0.05, 0.02)])
def test_from_the_needed_number_on_the_power_of_pairs_is_never_below(margin: float, disagreeing: float):
    needs = pair_needs(margin, 0.95, disagreeing, 0)
    assert needs is not None
    assert (pair_power(np.arange(needs.for_80, 2 * needs.for_80), margin, Z, disagreeing) >= 0.8).all()
    assert pair_power(np.array([needs.for_80 - 1]), margin, Z, disagreeing)[0] < 0.8


def test_no_number_of_pairs_shows_a_margin_of_nothing():
    assert pair_needs(0.0, 0.95, 0.05, 384) is None
