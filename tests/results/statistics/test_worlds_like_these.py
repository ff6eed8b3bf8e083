"""What is said of worlds that were not drawn: how much worlds differ, the rate, or why nothing."""

import pytest

from tasks.results.statistics.over_worlds import rate_over_worlds, worlds_like_these

UNLIKE = (48, 48, 48, 48, 48, 48, 40, 12)


def test_it_says_what_episodes_of_unlike_worlds_are_worth_and_the_rate_over_worlds():
    found = worlds_like_these(UNLIKE, [48] * 8, 0.95)
    assert found.interval == rate_over_worlds(UNLIKE, [48] * 8, 0.95)
    differ, rate = found.sentences()
    assert differ.startswith("Worlds differ (ICC 0.62, design effect 30.2): these 384 episodes tell as much about")
    assert differ.endswith("worlds like these as about 13 independent ones.")
    assert rate.startswith("The rate in worlds like these 8: 95\u00a0% interval ")


def test_it_says_so_where_no_difference_between_worlds_is_seen():
    said, _ = worlds_like_these([44, 43, 45, 44], [48] * 4, 0.95).sentences()
    assert said == "No difference between these worlds is seen (ICC 0.00, design effect 1.0)."


@pytest.mark.parametrize(
    ("counts", "refused", "sentences"),
    [
        (((7,), (8,)), "", 1),
        (((7, 8), (8, 8)), "the batch might have ended early", 2),
        (((), ()), "", 0),
        (((0, 0), (0, 0)), "", 0),
    ],
)
def test_it_says_why_nothing_is_said_of_the_rate(
    counts: tuple[tuple[int, ...], tuple[int, ...]], refused: str, sentences: int
):
    found = worlds_like_these(*counts, 0.95, refused=refused)
    assert found.interval is None
    said = found.sentences()
    assert len(said) == sentences
    assert not said or said[-1].startswith("Nothing is said of the rate in worlds like th")


def test_worlds_without_episodes_do_not_count():
    assert worlds_like_these([7, 0, 5], [8, 0, 8], 0.95) == worlds_like_these([7, 5], [8, 8], 0.95)
