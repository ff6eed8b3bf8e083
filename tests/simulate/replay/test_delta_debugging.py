"""Less of what fails: nothing of the answer can be left out, it is found together, and within what may be tried."""

from collections.abc import Sequence
from itertools import chain, combinations

from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.replay.smallest_case import Names, leave_out_singles, minimize_selection

ALL = tuple(f"piece-{number}" for number in range(24))
FEW = ALL[:5]


class Needs:
    """Fails wherever all of some pieces are; counts what it tries for the first time, within a budget."""

    def __init__(self, needed: frozenset[str], budget: int = 10_000) -> None:
        self.needed, self.budget, self.rounds = needed, budget, list[int]()
        self.known = set[Names]()

    def __call__(self, selections: Sequence[Names]) -> list[bool]:
        assert len(set(selections)) == len(selections)
        new = [names for names in selections if names not in self.known][: self.budget - sum(self.rounds)]
        self.rounds += [len(new)] if new else []
        self.known |= set(new)
        answered = selections[: next((at for at, names in enumerate(selections) if names not in self.known), None)]
        return [self.needed <= set(names) for names in answered]


def _parts(names: Names) -> list[Names]:
    return list(chain.from_iterable(combinations(names, size) for size in range(len(names) + 1)))


def _minimal(failing: set[Names]) -> set[Names]:
    """Returns, by brute force, all that fails and no longer does without any single one."""
    return {
        names for names in failing if not any(tuple(each for each in names if each != out) in failing for out in names)
    }


@given(st.sets(st.sampled_from(_parts(FEW))))
def test_the_answer_is_among_those_that_brute_force_finds_minimal(found_failing: set[Names]):
    failing = found_failing | {FEW}  # monotone or not
    for search in (minimize_selection, leave_out_singles):
        found = search(FEW, lambda selections: [names in failing for names in selections])
        assert found.minimal
        assert found.names in _minimal(failing)


@given(st.frozensets(st.sampled_from(ALL), max_size=6))
def test_what_is_needed_is_left_in_its_order(needed: frozenset[str]):
    for search in (minimize_selection, leave_out_singles):
        found = search(ALL, Needs(needed))
        assert found == (tuple(name for name in ALL if name in needed), True)


@given(st.frozensets(st.frozensets(st.sampled_from(ALL), min_size=1, max_size=3), min_size=1, max_size=4))
def test_of_several_causes_one_is_left_of_which_nothing_can_be_left_out(causes: frozenset[frozenset[str]]):
    def fails(selections: Sequence[Names]) -> list[bool]:
        return [any(cause <= set(names) for cause in causes) for names in selections]

    found = minimize_selection(ALL, fails)
    assert fails([found.names]) == [True]
    without = [tuple(name for name in found.names if name != left_out) for left_out in found.names]
    assert not any(fails(without))


@given(st.frozensets(st.sampled_from(ALL), max_size=6), st.integers(0, 60))
def test_no_more_is_tried_than_may_be_and_what_is_left_still_fails(needed: frozenset[str], budget: int):
    trials = Needs(needed, budget)
    found = minimize_selection(ALL, trials)
    assert sum(trials.rounds) <= budget
    assert needed <= set(found.names)
    if found.minimal:
        assert set(found.names) == needed


def test_rounds_are_few_because_all_of_a_round_is_tried_together():
    trials = Needs(frozenset({"piece-17"}))
    found = minimize_selection(ALL, trials)
    assert found.names == ("piece-17",)
    assert len(trials.rounds) <= 7  # nothing, and one for each halving


def test_what_can_be_left_out_by_itself_is_left_out_together():
    trials = Needs(frozenset({"piece-3", "piece-17"}))
    assert leave_out_singles(ALL, trials).names == ("piece-3", "piece-17")
    assert len(trials.rounds) == 3  # each one, all that went, and each of the two


def test_of_what_fails_in_a_round_the_smallest_is_taken():
    trials = Needs(frozenset(), 3)

    def fails(selections: Sequence[Names]) -> list[bool]:
        return [bool(names) for names, _ in zip(selections, trials(selections), strict=False)]

    assert minimize_selection(("a", "b", "c"), fails).names == ("a",)  # nothing; a; b and c


def test_a_failure_that_nothing_of_it_causes_needs_one_trial():
    trials = Needs(frozenset())
    assert minimize_selection(ALL, trials) == ((), True)
    assert trials.rounds == [1]


def test_a_failure_that_is_not_monotone_ends_too():
    def fails(selections: Sequence[Names]) -> list[bool]:
        return [len(names) in {24, 13, 12, 3} for names in selections]

    found = minimize_selection(ALL, fails)
    assert fails([found.names]) == [True]
