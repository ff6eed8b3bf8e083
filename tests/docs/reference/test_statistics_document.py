"""docs/reference/statistics.md: its tables are those that benchmarks wrote, its figures those of the code."""

import json
import re

import pytest

from benchmarks.harness import markdown, with_tables
from benchmarks.statistics.rates import shown
from benchmarks.statistics.resampled_worlds import counts, coverage, covered
from benchmarks.statistics.simulated_worlds import beta
from benchmarks.statistics.table_file import TABLES
from tasks.results.statistics.over_worlds import rate_over_worlds
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/reference/statistics.md").read_text()
TEXT = " ".join(DOCUMENT.split())
KEPT = json.loads(TABLES.read_text())


def test_every_table_is_one_that_a_benchmark_wrote():
    assert set(re.findall(r"<!-- end of (.*) -->", DOCUMENT)) == set(KEPT)
    for name, rows in KEPT.items():
        assert with_tables(DOCUMENT, name, markdown(rows)) == DOCUMENT, name


def test_no_rate_covers_less_or_passes_more_than_was_aimed_at():
    found = [tuple(map(float, cell.split(" / "))) for row in KEPT["rates"][1:] for cell in row[2:]]
    assert min(covers for covers, _ in found) >= 94.5
    assert max(wrong for _, wrong in found) <= 3.0


def test_no_paired_difference_covers_less_or_passes_more_than_was_aimed_at():
    found = [tuple(map(float, cell.split(" / "))) for row in KEPT["differences"][1:] for cell in row[3:]]
    assert min(covers for covers, _ in found) >= 94.5
    assert max(wrong for _, wrong in found) <= 3.0


def test_a_cell_simulated_again_in_small_is_what_the_page_says():
    [cell] = [row[4] for row in KEPT["rates"] if row[:2] == ["48 x 8", "0.9"]]
    covers, wrong = map(float, cell.split(" / "))
    above, below = shown(48, 8, beta(0.9, 0.1), 0.9, replicates=500)
    # Three standard errors of 500 batches.
    assert 100.0 * (1.0 - above - below) == pytest.approx(covers, abs=3.0)
    assert 100.0 * above == pytest.approx(wrong, abs=2.2)


def test_8_of_48_real_worlds_cover_the_rate_of_all_in_93_percent_or_more():
    for row in KEPT["real batches"][1:]:
        assert min(float(row[4]), float(row[5])) >= 93.0, row[0]


@pytest.mark.long
def test_the_table_of_real_batches_is_that_of_the_counts():
    assert coverage() == KEPT["real batches"]


def test_a_real_batch_resampled_in_small_covers():
    for found in counts().values():
        assert covered(found, "success", 1, replicates=100)[0] >= 0.87


def test_the_bounds_that_it_names_are_those_of_the_code():
    perfect = {worlds: rate_over_worlds([24] * worlds, [24] * worlds, 0.95).lower for worlds in (8, 48)}
    assert f"{perfect[8]:.2f} of 8 worlds, {perfect[48]:.2f} of 48" in TEXT
    assert f"A failure in each of 8 worlds of 48 gives {rate_over_worlds([47] * 8, [48] * 8, 0.95).lower:.3f}" in TEXT
    assert f"{100 * 0.9**8:.0f} % of 8 worlds, {100 * 0.9**16:.0f} % of 16, and {100 * 0.9**48:.1f} % of 48" in TEXT
