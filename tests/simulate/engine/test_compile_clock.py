"""What JAX compiles for is added up once, also where it tells of a part and of the whole."""

import jax
import jax.numpy as jnp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.devices import CompileClock, compiled_s, running_s

TRACE = "/jax/core/compile/jaxpr_trace_duration"


class Told:
    """A clock of compiling, told of intervals at their ends."""

    def __init__(self) -> None:
        self.at_s = 0.0
        self.clock = CompileClock(lambda: self.at_s)

    def interval(self, begin_s: float, end_s: float, event: str = TRACE) -> None:
        self.at_s = end_s
        self.clock.tell(event, end_s - begin_s)


def test_what_is_within_another_interval_is_counted_once():
    told = Told()
    for begin_s, end_s in ((1.0, 2.0), (4.0, 5.0), (3.5, 6.0), (0.5, 7.0), (8.0, 9.0)):
        told.interval(begin_s, end_s)
    assert told.clock.seconds == 7.5


def test_other_times_of_jax_are_not_counted():
    told = Told()
    told.interval(0.0, 5.0, "/jax/checkpoint/write_duration")
    assert told.clock.seconds == 0.0


def test_clocks_that_are_read_late_count_nothing_twice():
    told = Told()
    told.interval(1.0, 3.0)
    told.interval(2.9, 4.0)
    assert told.clock.seconds == pytest.approx(3.0)


@given(st.lists(st.integers(1, 50), min_size=1, max_size=600))
def test_intervals_that_lie_apart_are_added_up(durations: list[int]):
    told, at_s = Told(), 0.0
    for duration in durations:
        told.interval(at_s, at_s + duration)
        at_s += duration + 1
    assert told.clock.seconds == sum(durations)


def test_a_function_that_is_compiled_passes_no_running_time_and_one_that_is_there_compiles_nothing():
    function = jax.jit(lambda x: jnp.sin(x) + jnp.cos(x[::-1]) * 3.25)
    before_s = compiled_s()
    function(jnp.arange(17.0)).block_until_ready()
    compiled = compiled_s() - before_s
    assert compiled > 0.0
    before_s, ran_s = compiled_s(), running_s()
    function(jnp.arange(17.0)).block_until_ready()
    assert compiled_s() == before_s
    assert running_s() > ran_s
