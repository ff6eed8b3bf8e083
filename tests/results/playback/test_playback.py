"""Deviations: bit for bit, whatever kind of value a column holds."""

import math

import pyarrow as pa
import pytest

from tasks.results.playback.playback import recording_deviations, row_deviations
from tasks.results.tables.episode_tables import failures_table, results_table
from tests.factories.episodes import collided, passed, request


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (0.1, 0.1, (True, 0.0)),
        (1.0, 1.0 + 2**-52, (False, 2**-52)),
        (math.nan, math.nan, (True, 0.0)),
        (math.nan, 1.0, (False, math.inf)),
        (0.0, -0.0, (False, 0.0)),
        ([1.0, 2.0], [1.0, 2.5], (False, 0.5)),
        ([1.0, 2.0], [1.0], (False, math.inf)),
        ("stuck", "timeout", (False, math.inf)),
        (None, 1.0, (False, math.inf)),
        ([("a", 1.0)], [("a", 1.25)], (False, 0.25)),
        ([("a", 1.0)], [("b", 1.0)], (False, math.inf)),
    ],
)
def test_values_are_the_same_or_so_far_apart(before: object, after: object, expected: tuple[bool, float]):
    kind = pa.map_(pa.string(), pa.float64()) if isinstance(before, list) and isinstance(before[0], tuple) else None
    tables = [pa.table({"x": pa.array([each], kind)}) for each in (before, after)]
    (found,) = recording_deviations(*tables)
    assert (found.same, found.most) == expected


def test_a_recording_of_another_length_deviates():
    before, after = pa.table({"t_s": [0.0, 0.1]}), pa.table({"t_s": [0.0]})
    (found,) = recording_deviations(before, after)
    assert (found.same, found.most) == (False, math.inf)


def test_where_the_recording_lies_is_no_deviation():
    recorded = results_table("b", [request(0)], [passed(0).model_copy(update={"recording": "000000.parquet"})])
    assert all(each.same for each in row_deviations(recorded, "b", request(0), passed(0)))


def test_a_failure_that_passes_now_deviates_in_its_outcome():
    recorded = failures_table("b", [request(0)], [collided(0)])
    found = {each.column: each for each in row_deviations(recorded, "b", request(0), passed(0))}
    assert not found["outcome"].same
    assert found["outcome"].unit == ""
    assert found["simulated_s"].unit == "s"


def test_values_of_one_row_are_counted_with_their_noun():
    once, twice = (passed(0).model_copy(update={"goal_times_s": times}) for times in ((1.0,), (1.0, 2.0)))
    found = row_deviations(results_table("b", [request(0)], [once]), "b", request(0), twice)
    (times,) = [each for each in found if each.column == "goal_times_s"]
    assert (times.recorded, times.replayed) == ("1 value", "2 values")
