"""docs/guide/report.md: the limits that it names are those of the code, and what it links to is there."""

import itertools
import re
from pathlib import Path

from tasks.results.report.failure_maps import DRAWN, LISTED, MOST_MAPS
from tasks.results.report.rate_tables import MOST_ROWS
from tasks.results.report.report_page import MOST_WORLDS_READ, report_page
from tasks.results.statistics.intervals import IntervalFamily, in_worlds, percent_range, wilson
from tasks.results.statistics.over_worlds import worlds_like_these
from tests.factories.reports import view
from tests.repository import ROOT

PAGE = ROOT / "docs/guide/report.md"
DOCUMENT = " ".join(PAGE.read_text().split())


def test_the_limits_are_those_of_the_code():
    assert f"Tables show {MOST_ROWS} groups, maps {MOST_MAPS} worlds with {DRAWN} ways each, lists {LISTED}" in DOCUMENT
    assert f"the first {MOST_WORLDS_READ:,} worlds" in DOCUMENT


def test_every_section_of_the_page_is_described(tmp_path: Path):
    headings = re.findall(r"<h2 id=[^>]*>(.*?)</h2>", report_page(view(tmp_path)).decode())
    assert [heading for heading in headings if f"| {heading} |" not in DOCUMENT] == []


def test_what_it_links_to_is_there():
    assert [link for link in re.findall(r"\]\(([^)#]+)\)", DOCUMENT) if not (PAGE.parent / link).exists()] == []


def test_what_it_quotes_of_worlds_like_these_is_what_a_page_says():
    passed, n = [20, 28, *[48] * 6], [48] * 8
    said = f"87.5 %, 95 % interval (Wilson) {percent_range(wilson(336, 384, 0.95))} {in_worlds(8)}."
    quoted = " ".join([said, *worlds_like_these(passed, n, 0.95).sentences()])
    assert quoted.replace("\u00a0", " ") in DOCUMENT
    assert IntervalFamily(size=48, confidence=0.95).sentence().replace("\u00a0", " ") in DOCUMENT


def test_the_figures_of_families_are_those_of_the_benchmark():
    from benchmarks.results.families import exact_all, together  # noqa: PLC0415 - SciPy's statistics are slow to import

    decision = (ROOT / "docs/decisions/0032-intervals-that-hold-together.md").read_text()
    found = {(row[0], row[3]) for row in table_after(decision, "<!-- families -->")}
    for groups, n in ((8, 8), (48, 48)):
        held = together(n, IntervalFamily(size=groups, confidence=0.95), exact_all)
        assert (f"{groups} x {n}", f"{100 * held.min():.1f}, {100 * held.mean():.1f} %") in found


def table_after(document: str, mark: str) -> list[list[str]]:
    """Returns the cells of the table that follows a mark."""
    lines = document.partition(mark)[2].strip().splitlines()
    rows = itertools.takewhile(lambda line: line.startswith("|"), lines)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
