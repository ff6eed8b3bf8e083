"""What does not fit into memory comes back as it was, from one file however many arrays there are."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tasks.simulate.lane.recording import Overflow

ARRAYS = st.lists(arrays(st.sampled_from([np.float32, np.int32, np.bool_]), array_shapes(min_side=0)), max_size=6)

OPEN = Path("/proc/self/fd")


@given(ARRAYS, st.integers(0, 200))
def test_arrays_come_back_as_they_were(given_: list[np.ndarray], memory_bytes: int):
    overflow = Overflow(memory_bytes)
    kept = [overflow.keep(array) for array in given_]
    for array, each in zip(given_, kept, strict=True):
        back = overflow.get(each)
        assert (back.dtype, back.shape) == (array.dtype, array.shape)
        assert back.tobytes() == array.tobytes()
    late = overflow.keep(np.arange(5))
    assert overflow.get(late).tolist() == [0, 1, 2, 3, 4]


def test_a_view_of_every_other_row_is_kept_whole():
    array = np.arange(40, dtype=np.float32).reshape(8, 5)
    overflow = Overflow(0)
    assert np.array_equal(overflow.get(overflow.keep(array[::2])), array[::2])


@pytest.mark.skipif(not OPEN.exists(), reason="counts open files as Linux tells them")
def test_a_thousand_arrays_need_one_file():
    before = len(list(OPEN.iterdir()))
    overflow = Overflow(100)
    kept = [overflow.keep(np.full(64, number)) for number in range(1000)]
    assert all(overflow.get(each)[0] == number for number, each in enumerate(kept))
    assert len(list(OPEN.iterdir())) - before <= 3


def test_row_bytes_are_those_of_one_entry():
    assert Overflow(0).keep(np.zeros((4, 3, 2), np.float32)).row_bytes == 24
