"""Combinations of codes are told apart in the order in which they come, however many codes there could be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.episode_columns import Cells, distinct_cells, join_cells

# As a table of all combinations is made of few, and rows are sorted when there are many.
BOUNDS = (1, 3, 50, 1 << 40)


@pytest.mark.parametrize("bound", BOUNDS)
@given(data=st.data())
def test_combinations_come_in_the_order_of_their_first_rows(bound: int, data: st.DataObject) -> None:
    code = st.integers(-(bound // 2), bound - 1)
    rows = data.draw(st.lists(st.tuples(code, st.integers(0, 2), code), max_size=30))
    columns = [np.array([row[place] for row in rows], np.int64) for place in range(3)]
    first, which = distinct_cells(columns)
    seen = list(dict.fromkeys(rows))
    assert [rows[row] for row in first] == seen
    assert [seen[number] for number in which.tolist()] == rows
    assert first == [rows.index(each) for each in seen]


def test_no_rows_have_no_combinations() -> None:
    first, which = distinct_cells([np.zeros(0, np.int64), np.zeros(0, np.int64)])
    assert (first, which.tolist()) == ([], [])


def test_a_part_without_missing_values_is_there_as_a_whole() -> None:
    whole = Cells(numbers=np.array([1, 2]))
    partly = Cells(numbers=np.array([3, 0]), there=np.array([True, False]))
    there = join_cells([whole, partly], [2, 2]).there
    assert there is not None
    assert there.tolist() == [True, True, True, False]


def test_parts_without_missing_values_say_nothing_of_them() -> None:
    assert join_cells([Cells(numbers=np.array([1])), Cells(numbers=np.array([2]))], [1, 1]).there is None
