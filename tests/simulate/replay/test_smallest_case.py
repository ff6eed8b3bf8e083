"""Pieces and seed made less together: of the answer neither can be."""

from collections.abc import Sequence
from itertools import chain, combinations

from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.replay.smallest_case import Case, smallest_case

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
