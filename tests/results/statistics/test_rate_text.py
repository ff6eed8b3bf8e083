"""Rates in words: nothing is rounded to what it is not, and each says what it is a rate of."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.statistics.intervals import in_worlds, percent

counts = st.integers(1, 5000).flatmap(lambda episodes: st.tuples(st.integers(0, episodes), st.just(episodes)))


@pytest.mark.parametrize(
    ("worlds", "here", "elsewhere"),
    [
        (0, "in no world", "in no world"),
        (1, "in this 1 world", "in worlds like this 1"),
        (8, "in these 8 worlds", "in worlds like these 8"),
        (1200, "in these 1,200 worlds", "in worlds like these 1,200"),
    ],
)
def test_it_is_of_these_worlds_or_of_worlds_like_these(worlds: int, here: str, elsewhere: str):
    assert (in_worlds(worlds), in_worlds(worlds, like_these=True)) == (here, elsewhere)


@given(counts)
def test_only_all_is_printed_as_all_and_only_none_as_none(count: tuple[int, int]):
    successes, episodes = count
    shown = percent(successes / episodes)
    assert (shown == "100.0\u00a0%") == (successes == episodes)
    assert (shown == "0.0\u00a0%") == (successes == 0)
