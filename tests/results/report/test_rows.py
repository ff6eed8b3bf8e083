"""Groups as lines: what is printed is never on the wrong side of what is true."""

from hypothesis import given
from hypothesis import strategies as st

from tasks.results.report.rows import MOST_ROWS, clip, percent, rate_table, scale, short_world, worst_first
from tasks.results.statistics.intervals import wilson
from tasks.results.statistics.summary import EpisodeGroup


def group(successes: int, episodes: int, label: str = "g") -> EpisodeGroup:
    interval = wilson(successes, episodes, 0.95)
    return EpisodeGroup(label=label, episodes=episodes, successes=successes, canceled=0, interval=interval, reasons=())


counts = st.integers(0, 5000).flatmap(lambda episodes: st.tuples(st.integers(0, episodes), st.just(episodes)))


@given(counts)
def test_only_all_is_printed_as_all_and_only_none_as_none(count: tuple[int, int]):
    successes, episodes = count
    if episodes:
        shown = percent(successes / episodes)
        assert (shown == "100.0\u00a0%") == (successes == episodes)
        assert (shown == "0.0\u00a0%") == (successes == 0)


@given(st.lists(counts, min_size=1, max_size=6), st.none() | st.floats(0, 0.999))
def test_everything_drawn_lies_within_the_drawing(found: list[tuple[int, int]], goal: float | None):
    groups = [group(*count) for count in found]
    axis = scale(groups, goal)
    for each in groups:
        bar = axis.bar(each.interval, each.rate)
        begin, length = float(bar.begin[:-1]), float(bar.length[:-1])
        assert begin >= 0
        assert begin + length <= 100
        if bar.dot:
            assert begin - 0.02 <= float(bar.dot[:-1]) <= begin + length + 0.02
    if goal is not None:
        assert 0 < float(axis.goal[:-1]) < 100


def test_the_worst_group_comes_first_and_one_without_episodes_last():
    groups = [group(9, 10, "good"), group(0, 0, "empty"), group(1, 10, "bad")]
    assert [each.label for each in worst_first(groups)] == ["bad", "good", "empty"]


def test_a_long_table_is_cut_and_says_by_how_much():
    table = rate_table("By world", "World", [group(1, 2, f"w{number}") for number in range(100)], goal=None)
    assert len(table.rows) == MOST_ROWS
    assert table.left_out == 100 - MOST_ROWS


def test_worlds_of_one_generation_are_called_by_their_own_names():
    assert short_world(["a/w1", "a/w2"])("a/w1") == "w1"
    assert short_world(["a/w1", "b/w1"])("a/w1") == "a/w1"


def test_a_long_text_becomes_one_line_of_the_length():
    assert clip("a\n b", 10) == "a b"
    assert clip("x" * 20, 10) == "x" * 9 + "…"
