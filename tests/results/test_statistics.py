"""Wilson's interval."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics import wilson

counts = st.integers(0, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def test_the_textbook_example():
    # Newcombe 1998 (Statistics in Medicine 17:857), table I, method 3: 81 of 263 gives 0.2553 to 0.3662.
    interval = wilson(81, 263, 0.95)
    assert interval.lower == pytest.approx(0.2553, abs=5e-5)
    assert interval.upper == pytest.approx(0.3662, abs=5e-5)


@given(counts, st.floats(0.5, 0.9999))
def test_the_interval_holds_the_estimate_and_lies_in_0_to_1(count: tuple[int, int], confidence: float):
    successes, n = count
    interval = wilson(successes, n, confidence)
    assert 0.0 <= interval.lower <= interval.upper <= 1.0
    if n:
        assert interval.lower <= successes / n <= interval.upper


@given(counts.filter(lambda count: count[1] > 0))
def test_more_confidence_never_narrows_the_interval(count: tuple[int, int]):
    narrow, wide = wilson(*count, 0.8), wilson(*count, 0.99)
    assert wide.lower <= narrow.lower
    assert narrow.upper <= wide.upper


def test_nothing_counted_says_nothing():
    assert (wilson(0, 0, 0.95).lower, wilson(0, 0, 0.95).upper) == (0.0, 1.0)


@pytest.mark.parametrize(("successes", "n", "confidence"), [(2, 1, 0.9), (-1, 1, 0.9), (1, 1, 1.0), (1, 1, 0.0)])
def test_numbers_that_are_no_count_are_refused(successes: int, n: int, confidence: float):
    with pytest.raises(ValueError, match="successes"):
        wilson(successes, n, confidence)
