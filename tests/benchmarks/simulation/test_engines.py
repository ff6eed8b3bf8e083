"""What the simulation benchmark makes of its measurements, and where it puts them."""

import pytest

from benchmarks.harness import machine, with_tables
from benchmarks.simulation.engines import Turn, rows
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/reference/engines.md").read_text()


def test_the_best_of_what_one_writes_with_mujocos_package_is_the_measure():
    found = {
        "mj_step loop": [Turn(1e3, 20.0)],
        "mujoco.batch": [Turn(2e3, 10.0), Turn(9e3, 9.0), Turn(4e3, 11.0)],
        "planar": [Turn(80e3, 1.0)],
    }
    table = {name: cells for name, *cells in rows(found)[1:]}
    assert table["mujoco.batch"] == ["4.0", "2.0", "9.0", "1.00", "10.0"]
    assert [table[name][3] for name in ("mj_step loop", "planar")] == ["0.25", "20.00"]


@pytest.mark.parametrize("name", ["machine", "side by side", "lanes", "obstacles", "batch"])
def test_the_document_has_a_place_for_each_table(name: str):
    assert "some figures" in with_tables(DOCUMENT, name, "some figures")


def test_the_machine_is_told_with_its_cores_and_versions():
    assert all(word in machine() for word in ("cores", "Python", "MuJoCo", "JAX"))
