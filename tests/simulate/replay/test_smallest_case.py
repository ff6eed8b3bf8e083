"""What makes two failures the same: kind, goal and place, each by itself."""

from collections.abc import Mapping, Sequence
from itertools import chain, combinations
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks.simulate.replay.smallest_case as shrinking
from specs.data.episode import EpisodeResult, Failure, failed_result
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.replay.smallest_case import (
    Case,
    Ending,
    Names,
    Trial,
    is_of_same_kind,
    is_same_failure,
    leave_out_singles,
    minimize_selection,
    simulate_trials,
    smallest_case,
)
from tests.factories.simulations import FOLDERS, delivery, hall

ROW = failed_result(0, Failure("InternalServiceError", "noted")).model_copy(
    update={"status": "Completed", "failure_code": "", "outcome_reason": "collision", "goals_reached": 1}
)
FIRST = Ending(ROW, (3.0, 2.0))


def _changed(goal_m: tuple[float, float] | None = FIRST.goal_m, **changes: object) -> Ending:
    return Ending(ROW.model_copy(update=changes), goal_m)


@pytest.mark.parametrize(
    "other",
    [
        _changed(final_x_m=0.7, final_y_m=-0.7),
        _changed((3.6, 1.4)),
        _changed(simulated_s=9.0, collisions=3),
    ],
)
def test_within_a_metre_it_is_the_same_failure(other: Ending):
    assert is_same_failure(FIRST, other)


@pytest.mark.parametrize(
    "other",
    [
        _changed(final_x_m=0.8, final_y_m=-0.8),
        _changed((3.8, 1.2)),
        _changed(None),
        _changed(goals_reached=0),
    ],
    ids=["elsewhere", "to a goal elsewhere", "to no known goal", "to the goal before"],
)
def test_elsewhere_or_on_another_way_it_is_another_failure_of_that_kind(other: Ending):
    assert is_of_same_kind(FIRST, other)
    assert not is_same_failure(FIRST, other)


@pytest.mark.parametrize(
    "other",
    [_changed(outcome_reason="stuck"), _changed(failure_code="RobotApplicationCrash"), _changed(status="Failed")],
    ids=["reason", "code", "status"],
)
def test_with_another_reason_it_is_no_failure_of_that_kind(other: Ending):
    assert not is_of_same_kind(FIRST, other)
    assert not is_same_failure(FIRST, other)


def test_of_episodes_that_never_began_the_reason_says_all():
    assert is_same_failure(Ending(ROW), Ending(ROW))


class Noted:
    """Lanes that note how many episodes each chunk has."""

    def __init__(self, **_: object) -> None:
        self.sizes: list[int] = []

    def simulate(self, chunk: Chunk, _worlds: Mapping[str, World]) -> list[EpisodeResult]:
        self.sizes.append(len(chunk.requests))
        return [failed_result(each.index, Failure("InternalServiceError", "noted")) for each in chunk.requests]


@pytest.mark.parametrize(("holds", "sizes"), [(3, [3, 3, 1]), (None, [5, 2]), (100, [5, 2])])
def test_trials_are_split_as_the_machine_holds_them(
    monkeypatch: pytest.MonkeyPatch, holds: int | None, sizes: list[int]
):
    lanes = Noted()
    monkeypatch.setattr(shrinking, "SandboxClient", lambda **_: lanes)
    monkeypatch.setattr(shrinking, "batch_mounts", lambda _: SimpleNamespace(resolved=lambda request: request))
    monkeypatch.setattr(shrinking, "most_lanes", lambda _requests, _bundles: holds)
    batch: Any = SimpleNamespace(plan=SimpleNamespace(lanes=5, engine="auto"))
    world = hall(2.0)
    tried = [Trial(world, seed) for seed in range(7)]
    endings = simulate_trials(batch, delivery(0, world="hand/one"), tried, FOLDERS)
    assert [ending.row.index for ending in endings] == list(range(7))
    assert lanes.sizes == sizes
    assert {ending.goal_m for ending in endings} == {None}  # nothing was recorded


ALL = tuple(f"piece-{number}" for number in range(24))
FEW_NAMES = ALL[:5]


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


@given(st.sets(st.sampled_from(_parts(FEW_NAMES))))
def test_the_answer_is_among_those_that_brute_force_finds_minimal(found_failing: set[Names]):
    failing = found_failing | {FEW_NAMES}  # monotone or not
    for search in (minimize_selection, leave_out_singles):
        found = search(FEW_NAMES, lambda selections: [names in failing for names in selections])
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


FEW, SEED = ("a", "b", "c", "d"), 3
CASES = [
    Case(names, seed)
    for names in chain.from_iterable(combinations(FEW, size) for size in range(len(FEW) + 1))
    for seed in range(SEED + 1)
]


def _less(case: Case) -> list[Case]:
    without = [case._replace(names=tuple(name for name in case.names if name != out)) for out in case.names]
    return without + [case._replace(seed=lower) for lower in range(case.seed)]


@given(st.sets(st.sampled_from(CASES)))
def test_at_the_final_seed_no_piece_can_go_and_with_the_final_pieces_no_lower_seed_fails(some: set[Case]):
    failing = some | {Case(FEW, SEED)}
    found, minimal = smallest_case(Case(FEW, SEED), lambda cases: [case in failing for case in cases])
    assert minimal
    assert found in failing
    assert not failing & set(_less(found))


def test_a_seed_that_needs_fewer_pieces_is_used():
    failing = {Case(FEW, 3), Case(("a", "b"), 3), Case(("a", "b"), 1), Case(("b",), 1), Case(("b",), 0)}

    def fails(cases: Sequence[Case]) -> list[bool]:
        return [case in failing for case in cases]

    assert smallest_case(Case(FEW, 3), fails) == (Case(("b",), 0), True)


def test_where_nothing_more_may_be_tried_it_is_not_called_minimal():
    assert smallest_case(Case(FEW, SEED), lambda _: []) == (Case(FEW, SEED), False)
