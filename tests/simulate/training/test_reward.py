"""What the reward for progress pays."""

import jax.numpy as jnp
import pytest

from tasks.simulate.application.contract import REASONS, Observation, Truth, Verdict
from tasks.simulate.training.training_spaces import Transition, progress


def paid(
    *, gained_m: float = 0.0, impulse_ns: float = 0.0, reached: int = 0, done: bool = False, reason: str = ""
) -> float:
    zero, nothing = jnp.zeros(()), jnp.zeros(2)
    seen = Observation(
        zero, jnp.zeros(3), jnp.zeros(3), jnp.zeros(0), jnp.int32(0), nothing, nothing, jnp.zeros(0, bool)
    )
    truth = Truth(zero, jnp.zeros(3), jnp.zeros(3), zero, jnp.float32(impulse_ns), jnp.bool_(True))  # noqa: FBT003 - JAX's form
    verdict = Verdict(jnp.int32(reached), jnp.bool_(done), jnp.int32(REASONS.index(reason)))
    step = Transition(seen, seen, nothing, truth, verdict, jnp.float32(2.0), jnp.float32(2.0 - gained_m))
    return float(progress(step))


def test_progress_is_paid_by_the_metre_and_a_step_costs_a_little():
    assert paid(gained_m=0.025) == pytest.approx(0.02, abs=1e-6)
    assert paid() == pytest.approx(-0.005)


def test_contacts_cost_but_never_without_bound():
    assert paid(impulse_ns=0.1) == pytest.approx(-0.105)
    assert paid(impulse_ns=1e9) == pytest.approx(-1.005)


def test_goals_are_worth_more_than_any_way_to_them_in_a_step():
    assert paid(reached=1) == pytest.approx(4.995)


@pytest.mark.parametrize(
    ("reason", "cost"), [("collision", 5.0), ("stuck", 5.0), ("out of bounds", 5.0), ("crash", 5.0), ("timeout", 0.0)]
)
def test_bad_ends_cost_and_the_end_of_time_does_not(reason: str, cost: float):
    assert paid(done=True, reason=reason) == pytest.approx(-0.005 - cost)
