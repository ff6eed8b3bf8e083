"""A drawn order: each position once, the same wherever it is drawn."""

from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.plan.chunks import Shuffle


@given(st.integers(0, 200), st.text(max_size=3))
def test_each_position_has_one_turn(size: int, seed: str):
    shuffle = Shuffle(size, seed)
    assert sorted(shuffle.order) == list(range(size))
    assert [shuffle.order[turn] for turn in shuffle.turn] == list(range(size))


def test_the_order_follows_from_the_seed_and_is_the_same_on_any_machine():
    assert Shuffle(8, "simyard").order == (3, 4, 7, 2, 6, 1, 5, 0)
    assert Shuffle(100, "a").order != Shuffle(100, "b").order
