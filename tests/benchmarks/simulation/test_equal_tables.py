"""The tables that docs/reference/engines.md calls equal are equal, and a digest sees one bit of one row."""

import re

import numpy as np

from benchmarks.simulation.equal_tables import FLOORPLANS, INTERIORS, noisy_deliveries, table_digest
from tests.factories.episodes import passed
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/reference/engines.md").read_text()


def test_all_tables_of_the_document_have_one_digest():
    table = DOCUMENT.partition("<!-- equal tables planar -->")[2].partition("<!-- end of equal tables planar -->")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in re.findall(r"^\|.*\|$", table, re.M)[2:]]
    assert {(int(row[0]), row[1]) for row in rows} == {
        (lanes, order) for lanes in (16, 32, 192, 768) for order in ("given", "shuffled")
    }
    assert {(row[3], row[4]) for row in rows} == {("0", "0")}
    assert len({row[5] for row in rows}) == 1


def test_a_digest_sees_the_last_bit_of_one_row():
    rows = [passed(k) for k in range(3)]
    other = rows[1].model_copy(update={"final_x_m": float(np.nextafter(rows[1].final_x_m, 9.0))})
    assert table_digest(rows) != table_digest([rows[0], other, rows[2]])


def test_the_document_counts_768_episodes():
    worlds = [f"mixed/{k}" for k in range(FLOORPLANS * INTERIORS)]
    assert [request.index for request in noisy_deliveries(worlds, 48)] == list(range(768))
