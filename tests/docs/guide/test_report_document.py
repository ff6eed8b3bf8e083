"""docs/guide/report.md: the limits that it names are those of the code, and what it links to is there."""

import re
from pathlib import Path

from tasks.results.report.maps import DRAWN, LISTED, MOST_MAPS
from tasks.results.report.page import report_page
from tasks.results.report.report_job import MOST_WORLDS
from tasks.results.report.rows import MOST_ROWS
from tests.factories.reports import view
from tests.repository import ROOT

DOCS = ROOT / "docs/guide"
DOCUMENT = " ".join((DOCS / "report.md").read_text().split())


def test_the_limits_are_those_of_the_code():
    assert f"Tables show {MOST_ROWS} groups, maps {MOST_MAPS} worlds with {DRAWN} ways each, lists {LISTED}" in DOCUMENT
    assert f"the first {MOST_WORLDS:,} worlds" in DOCUMENT


def test_every_section_of_the_page_is_described(tmp_path: Path):
    headings = re.findall(r"<h2 id=[^>]*>(.*?)</h2>", report_page(view(tmp_path)).decode())
    assert [heading for heading in headings if f"| {heading} |" not in DOCUMENT] == []


def test_what_it_links_to_is_there():
    assert [link for link in re.findall(r"\]\(([^)#]+)\)", DOCUMENT) if not (DOCS / link).exists()] == []
