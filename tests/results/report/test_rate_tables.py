"""Groups as lines: what is printed is never on the wrong side of what is true."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.results.report.rate_tables import MOST_ROWS, Grouped, clip, family_of, rate_table, short_world, worst_first
from tasks.results.statistics.batch_summary import EpisodeGroup
from tasks.results.statistics.intervals import IntervalFamily, percent_range, wilson


def group(successes: int, episodes: int, label: str = "g") -> EpisodeGroup:
    interval = wilson(successes, episodes, 0.95)
    return EpisodeGroup(label=label, episodes=episodes, successes=successes, canceled=0, interval=interval, reasons=())


counts = st.integers(0, 5000).flatmap(lambda episodes: st.tuples(st.integers(0, episodes), st.just(episodes)))


@given(st.lists(counts, min_size=1, max_size=6), st.none() | st.floats(0, 0.999))
def test_everything_drawn_lies_within_the_drawing(found: list[tuple[int, int]], goal: float | None):
    groups = [group(*count) for count in found]
    made = Grouped("By world", "here", "World", groups)
    table = rate_table(made, family_of([made], 0.95), goal)
    for bar in (bar for row in table.rows for bar in (row.bar, row.bar_alone)):
        begin, length = float(bar.begin[:-1]), float(bar.length[:-1])
        assert begin >= 0
        assert begin + length <= 100
        if bar.dot:
            assert begin - 0.02 <= float(bar.dot[:-1]) <= begin + length + 0.02
    if goal is not None:
        assert 0 < float(table.scale.goal[:-1]) < 100


def test_the_worst_group_comes_first_and_one_without_episodes_last():
    groups = [group(9, 10, "good"), group(0, 0, "empty"), group(1, 10, "bad")]
    assert [each.label for each in worst_first(groups)] == ["bad", "good", "empty"]


def test_worlds_that_did_as_well_are_counted_up_by_number():
    names = ["g/world-10", "g/world-9", "g/world-2"]
    assert [each.label for each in worst_first([group(2, 2, name) for name in names])] == names[::-1]


@pytest.mark.parametrize(("passed", "failed", "folds"), [(4, 1, True), (3, 1, False), (40, 0, False)])
def test_worlds_where_all_passed_are_folded_where_they_are_many_and_others_did_not(
    passed: int, failed: int, *, folds: bool
):
    groups = [*(group(0, 2) for _ in range(failed)), *(group(2, 2) for _ in range(passed))]
    made = Grouped("By world", "here", "World", groups, folds=True)
    assert rate_table(made, family_of([made], 0.95), None).folds is folds
    assert not rate_table(made._replace(folds=False), family_of([made], 0.95), None).folds


def test_a_long_table_is_cut_and_says_by_how_much():
    made = Grouped("By world", "here", "World", [group(1, 2, f"w{number}") for number in range(100)])
    table = rate_table(made, family_of([made], 0.95), None)
    assert len(table.rows) == MOST_ROWS
    assert table.left_out == 100 - MOST_ROWS


@given(st.lists(st.lists(counts, max_size=60), max_size=4), st.floats(0.5, 0.999))
def test_a_family_has_the_groups_of_all_tables_also_those_that_are_left_out(
    found: list[list[tuple[int, int]]], confidence: float
):
    tables = [Grouped("By world", "here", "World", [group(*count) for count in some]) for some in found]
    family = family_of(tables, confidence)
    assert family.size == sum(episodes > 0 for some in found for _, episodes in some)
    for made in tables:
        rows = rate_table(made, family, None).rows
        wide = [family.interval(each.successes, each.episodes) for each in made.groups]
        assert [row.interval for row in rows] == [percent_range(each) for each in wide[:MOST_ROWS]]
        assert [row.alone for row in rows] == [percent_range(each.interval) for each in made.groups[:MOST_ROWS]]


def test_a_family_is_larger_than_what_is_shown_of_it():
    """The worst forty are chosen after looking at all, so that all count."""
    made = Grouped("By world", "here", "World", [group(1, 2, f"w{number}") for number in range(100)])
    assert family_of([made, made], 0.95) == IntervalFamily(size=200, confidence=0.95)


def test_worlds_of_one_generation_are_called_by_their_own_names():
    assert short_world(["a/w1", "a/w2"])("a/w1") == "w1"
    assert short_world(["a/w1", "b/w1"])("a/w1") == "a/w1"


def test_a_long_text_becomes_one_line_of_the_length():
    assert clip("a\n b", 10) == "a b"
    assert clip("x" * 20, 10) == "x" * 9 + "…"
