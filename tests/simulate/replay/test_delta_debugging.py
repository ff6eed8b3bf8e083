"""Less of what fails: nothing of the answer can be left out, it is found together, and within the budget."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.replay.delta_debugging import Names, minimize_selection

ALL = tuple(f"piece-{number}" for number in range(24))


class Needs:
    """Fails wherever all of some pieces are, and counts what it was asked."""

    def __init__(self, needed: frozenset[str]) -> None:
        self.needed, self.rounds = needed, list[int]()

    def __call__(self, selections: Sequence[Names]) -> list[bool]:
        assert len(set(selections)) == len(selections)
        self.rounds.append(len(selections))
        return [self.needed <= set(names) for names in selections]


@given(st.frozensets(st.sampled_from(ALL), max_size=6))
def test_what_is_needed_is_left_in_its_order(needed: frozenset[str]):
    found = minimize_selection(ALL, Needs(needed), 10_000)
    assert found.names == tuple(name for name in ALL if name in needed)
    assert found.minimal


@given(st.frozensets(st.frozensets(st.sampled_from(ALL), min_size=1, max_size=3), min_size=1, max_size=4))
def test_of_several_causes_one_is_left_of_which_nothing_can_be_left_out(causes: frozenset[frozenset[str]]):
    def fails(selections: Sequence[Names]) -> list[bool]:
        return [any(cause <= set(names) for cause in causes) for names in selections]

    found = minimize_selection(ALL, fails, 10_000)
    assert fails([found.names]) == [True]
    without = [tuple(name for name in found.names if name != left_out) for left_out in found.names]
    assert not any(fails(without))


@given(st.frozensets(st.sampled_from(ALL), max_size=6), st.integers(0, 60))
def test_the_budget_is_kept_and_what_is_left_still_fails(needed: frozenset[str], budget: int):
    trials = Needs(needed)
    found = minimize_selection(ALL, trials, budget)
    assert found.tried == sum(trials.rounds) <= budget
    assert needed <= set(found.names)
    if found.minimal:
        assert set(found.names) == needed


def test_rounds_are_few_because_all_of_a_round_is_tried_together():
    trials = Needs(frozenset({"piece-17"}))
    found = minimize_selection(ALL, trials, 10_000)
    assert found.names == ("piece-17",)
    assert len(trials.rounds) <= 7  # nothing, and one for each halving


def test_of_what_fails_in_a_round_the_smallest_is_taken():
    def fails(selections: Sequence[Names]) -> list[bool]:
        return [bool(names) for names in selections]

    assert minimize_selection(("a", "b", "c"), fails, 3).names == ("a",)  # nothing; a; b and c


def test_a_failure_that_nothing_of_it_causes_needs_one_trial():
    assert minimize_selection(ALL, Needs(frozenset()), 10) == ((), 1, True)


def test_a_failure_that_is_not_monotone_ends_too():
    def fails(selections: Sequence[Names]) -> list[bool]:
        return [len(names) in {24, 13, 12, 3} for names in selections]

    found = minimize_selection(ALL, fails, 10_000)
    assert fails([found.names]) == [True]
