"""Arrow arrays made of cells hold what the cells do, and nothing but Arrow and NumPy makes them."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from specs.data.episode_columns import Cells, label_cells
from tasks.results.tables.episode_tables import arrow_array, arrow_mask

NUMBERS = np.array([3, 0, 2])
THERE = np.array([True, False, True])
LENGTHS = np.array([2, 0, 1])
NAMES = label_cells(["hall", "küche", "hall"])
COLUMNS: list[tuple[Cells, pa.DataType, list[object]]] = [
    (Cells(numbers=NUMBERS), pa.int32(), [3, 0, 2]),
    (Cells(numbers=NUMBERS), pa.float64(), [3.0, 0.0, 2.0]),
    (Cells(numbers=NUMBERS, there=THERE), pa.int64(), [3, None, 2]),
    (Cells(numbers=np.arange(6.0).reshape(3, 2)[:, 1]), pa.float64(), [1.0, 3.0, 5.0]),
    (Cells(labels=("b/0", "b/1")), pa.string(), ["b/0", "b/1"]),
    (NAMES, pa.string(), ["hall", "küche", "hall"]),
    (label_cells([True, None, False, True]), pa.bool_(), [True, None, False, True]),
    (label_cells([30.0, None, 2.5]), pa.float64(), [30.0, None, 2.5]),
    (NAMES._replace(lengths=LENGTHS), pa.list_(pa.string()), [["hall", "küche"], [], ["hall"]]),
    (Cells(numbers=np.arange(3.0), lengths=LENGTHS), pa.list_(pa.float64()), [[0.0, 1.0], [], [2.0]]),
    (
        NAMES._replace(numbers=np.arange(3.0), lengths=LENGTHS),
        pa.map_(pa.string(), pa.float64()),
        [[("hall", 0.0), ("küche", 1.0)], [], [("hall", 2.0)]],
    ),
    (
        label_cells([(("A", "1"), ("B", "é")), (), (("A", "1"), ("B", "é"))]),
        pa.map_(pa.string(), pa.string()),
        [[("A", "1"), ("B", "é")], [], [("A", "1"), ("B", "é")]],
    ),
]


@pytest.mark.parametrize(("cells", "kind", "values"), COLUMNS)
def test_an_array_is_what_arrow_makes_of_the_values(cells: Cells, kind: pa.DataType, values: list[object]):
    array = arrow_array(cells, kind)
    array.validate(full=True)
    assert array.equals(pa.array(values, kind))
    assert array.type.equals(kind, check_metadata=True)


@pytest.mark.parametrize(("cells", "kind"), [column[:2] for column in COLUMNS])
def test_no_rows_make_an_empty_array(cells: Cells, kind: pa.DataType):
    held = cells.codes is not None or cells.numbers is not None
    array = arrow_array(cells.take(np.zeros(0, np.int64)) if held else Cells(), kind)
    array.validate(full=True)
    assert array.equals(pa.array([], kind))


@pytest.mark.parametrize("number", [1 << 31, 0.5, np.nan])
def test_a_number_that_a_type_does_not_hold_is_refused(number: float):
    with pytest.raises(ValueError, match="no int32"):
        arrow_array(Cells(numbers=np.array([number])), pa.int32())


@pytest.mark.parametrize("number", [1 << 40, np.nan])
def test_what_stands_where_no_value_is_does_not_matter(number: float):
    cells = Cells(numbers=np.array([1, number]), there=np.array([True, False]))
    assert arrow_array(cells, pa.int32()).to_pylist() == [1, None]


def test_a_mask_picks_the_rows_that_are_meant():
    rows = pa.table({"row": list(range(11))})
    assert rows.filter(arrow_mask(np.arange(11) % 3 == 1)).column("row").to_pylist() == [1, 4, 7, 10]


def test_tables_are_written_without_pandas():
    code = """
import sys
from pathlib import Path
from tasks.results.tables.parquet import write_parquet
from tasks.results.tables.episode_tables import failures_table
from tests.factories.episodes import collided, request
write_parquet(failures_table("b", [request(0)], [collided(0)]), Path(sys.argv[1]))
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code, "/dev/null"], check=True)
