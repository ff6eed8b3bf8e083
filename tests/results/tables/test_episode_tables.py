"""Tables of episodes: rows, columns of a sweep, and arrays that are those of pyarrow."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.episode_columns import Cells, label_cells
from specs.data.result_columns import SCHEMA_VERSION
from tasks.results.tables.episode_tables import (
    FAILURES,
    RESULTS,
    arrow_array,
    arrow_mask,
    failures_table,
    results_table,
    sweep_variables,
)
from tests.factories.episodes import TRAJECTORY, canceled, collided, crashed, episodes, passed, request


def test_there_is_a_row_an_episode_in_the_order_of_their_indices():
    requests = [request(index, seed=10 + index) for index in range(3)]
    table = results_table("simb-1", requests[::-1], [passed(2), collided(0), crashed(1)])
    assert table.column("job").to_pylist() == ["simb-1/0", "simb-1/1", "simb-1/2"]
    assert table.column("seed").to_pylist() == [10, 11, 12]
    assert table.column("outcome_reason").to_pylist() == ["collision", "", ""]


def test_a_crash_is_no_success_even_with_all_goals_reached_and_a_cancel_is_neither():
    requests = [request(index) for index in range(4)]
    table = results_table("b", requests, [passed(0), collided(1), crashed(2), canceled(3)])
    assert table.column("success").to_pylist() == [True, False, False, None]


def test_failures_are_the_episodes_that_did_not_pass_with_reason_and_trajectory():
    requests = [request(index) for index in range(4)]
    table = failures_table("b", requests, [passed(0), collided(1), crashed(2), canceled(3)])
    assert table.column("index").to_pylist() == [1, 2]
    assert table.column("reason").to_pylist() == ["collision", "RobotApplicationCrash"]
    assert table.column("trajectory_x_m").to_pylist() == [[pose[1] for pose in TRAJECTORY], []]
    assert table.column("trajectory_yaw_rad").to_pylist()[0] == [pose[3] for pose in TRAJECTORY]


def test_a_swept_number_gets_a_column_and_a_swept_word_does_not():
    requests = [
        request(0, environment={"MAX_SPEED": "0.3", "MODE": "careful"}),
        request(1, environment={"MAX_SPEED": "0.6", "MODE": "2"}),
        request(2),
    ]
    variables = sweep_variables({"MAX_SPEED": ["0.3", "0.6", None], "MODE": ["careful", "2", None]})
    table = results_table("b", requests, [passed(index) for index in range(3)], variables)
    assert table.column("env_MAX_SPEED").to_pylist() == [0.3, 0.6, None]
    assert "env_MODE" not in table.column_names
    assert table.column("environment").to_pylist()[1] == [("MAX_SPEED", "0.6"), ("MODE", "2")]


def test_words_that_float_reads_but_that_are_no_quantity_are_no_sweep():
    assert sweep_variables({"A": ["nan"], "C": ["1e3"], "B": ["1", "inf"]}) == ["C"]


@pytest.mark.parametrize(
    "results", [[passed(0)], [passed(0), passed(0)], [passed(0), passed(2)], [passed(0), passed(1), passed(2)]]
)
def test_requests_and_results_that_do_not_pair_up_are_refused(results: list[EpisodeResult]):
    with pytest.raises(ValueError, match="pair up"):
        results_table("b", [request(0), request(1)], results)


def test_a_table_of_no_episodes_has_all_columns():
    assert results_table("b", [], []).schema.equals(RESULTS, check_metadata=True)
    assert failures_table("b", [], []).schema.equals(FAILURES, check_metadata=True)


def test_the_schema_says_its_version_and_every_column_its_meaning_and_unit():
    for schema in (RESULTS, FAILURES):
        assert (schema.metadata or {})[b"simyard.schema_version"].decode() == SCHEMA_VERSION
        for field in schema:
            metadata = field.metadata or {}
            assert metadata[b"description"].decode().endswith(".")
            unit = metadata[b"unit"].decode().lower().replace("/", "_")
            assert field.name.endswith(f"_{unit}") or not unit


def test_every_field_of_requests_and_results_is_a_column():
    # Five columns each, four lists, part of the column environment, and the column robot.
    elsewhere = {"robot", "scenario", "trajectory", "judge_environment", "number"}
    asked = set(EpisodeRequest.model_fields) - elsewhere
    answered = set(EpisodeResult.model_fields) - elsewhere
    assert asked <= set(RESULTS.names)
    assert answered - {"failure_reason"} <= set(RESULTS.names)
    assert answered <= set(FAILURES.names)


@given(episodes())
def test_what_the_simulation_application_has_otherwise_stands_beside_the_other_variables(
    drawn: tuple[list[EpisodeRequest], list[EpisodeResult]],
):
    requests, results = drawn
    otherwise = [
        request.model_copy(update={"environment": {"SPEED": "1"}, "judge_environment": {"SPEED": "2"}})
        for request in requests
    ]
    cells = results_table("b", otherwise, results).column("environment").to_pylist()
    assert cells == [[("SPEED", "1"), ("simulation:SPEED", "2")]] * len(requests)


@given(episodes())
def test_the_order_of_the_input_changes_nothing(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    requests, results = drawn
    table = results_table("b", requests, results)
    assert table.equals(results_table("b", requests[::-1], results[::-1]), check_metadata=True)


@given(episodes())
def test_success_in_the_tables_splits_the_batch(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    requests, results = drawn
    table = results_table("b", requests, results)
    answers: list[bool | None] = table.column("success").to_pylist()
    assert failures_table("b", requests, results).num_rows == answers.count(False)


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
