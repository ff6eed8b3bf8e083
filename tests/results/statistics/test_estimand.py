"""What a rate is a rate of."""

import pytest

from tasks.results.statistics.estimand import in_worlds


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
