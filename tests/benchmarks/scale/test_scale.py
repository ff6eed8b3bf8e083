"""The tables of `benchmarks.scale.scale` say what a run took."""

from typing import cast

import pytest

from benchmarks.scale.scale import Case, Run, crew_table, section, size_table, wait_table

RUN = Run("", 48_000, 200.0, 180.0, 30.0, 10.0, 100.0, 1, 300.4, 900.2, "same")


def _cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if "|" in line][2:]


def test_a_case_has_all_its_episodes_in_its_matrix():
    batch = section(Case(48_000, 16, 512, 20))
    assert cast("dict[str, object]", batch["matrix"])["seeds"] == 1500
    assert batch["batchPolicy"] == {"timeoutInSeconds": 7200, "maxConcurrency": 512}


def test_the_parts_of_a_batch_add_up_to_its_wall_clock():
    cells = _cells(wait_table(RUN))
    assert [(row[0], row[1], row[2]) for row in cells] == [
        ("driving", "100.0", "50"),
        ("lanes made ready", "30.0", "15"),
        ("programs", "10.0", "5"),
        ("the rest", "60.0", "30"),
        ("the flow", "200.0", "100"),
    ]
    assert "300 MB" in wait_table(RUN)
    assert "900 MB" in wait_table(RUN)


def test_what_is_not_simulation_is_shared_by_all_workers():
    assert _cells(size_table([RUN]))[0] == ["48,000", "200.0", "140.0", "30.0", "300", "900"]
    assert _cells(size_table([RUN._replace(workers=2)]))[0][2:4] == ["70.0", "65.0"]


def test_crews_that_wrote_other_tables_are_refused():
    with pytest.raises(ValueError, match="differ"):
        crew_table([RUN, RUN._replace(tables="other")])
