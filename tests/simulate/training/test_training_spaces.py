"""What an action does to the actuators."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import DocumentError
from tasks.simulate.application.contract import REASONS, Observation, Truth, Verdict
from tasks.simulate.training.training_spaces import Transition, action_map, control_of, progress
from tests.factories.simulations import COURIER, FOLDERS

ROBOT = FOLDERS[COURIER] / "robot.xml"
UNLIMITED = """
<mujoco><worldbody><body name="base" pos="0 0 .2"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="y" type="slide" axis="0 1 0"/><joint name="yaw" type="hinge" axis="0 0 1"/>
<geom type="sphere" size=".18" mass="2"/></body></worldbody>
<actuator><velocity joint="x" kv="1"/></actuator></mujoco>
"""


def test_the_actuators_with_a_range_are_driven_and_the_others_held():
    actions = action_map(ROBOT, normalized=True)
    assert actions.names == ("forward", "turn")
    assert control_of(actions, jnp.array([0.5, -1.0])).tolist() == [0.5, -3.0, 0.0]


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=2, max_size=2))
def test_a_control_is_never_beyond_its_range(action: list[float]):
    for normalized in (True, False):
        actions = action_map(ROBOT, normalized=normalized)
        control = np.asarray(control_of(actions, jnp.array(action, jnp.float32)))[:2]
        assert (control >= actions.low).all()
        assert (control <= actions.high).all()


def test_a_raw_action_is_the_control():
    actions = action_map(ROBOT, normalized=False)
    assert (actions.least.tolist(), actions.most.tolist()) == ([-1.0, -3.0], [1.0, 3.0])
    assert control_of(actions, jnp.array([0.25, 2.5])).tolist() == [0.25, 2.5, 0.0]


def test_a_robot_without_a_control_range_is_refused_with_the_remedy(tmp_path: Path):
    (tmp_path / "robot.xml").write_text(UNLIMITED)
    with pytest.raises(DocumentError, match="at least one actuator with a ctrlrange"):
        action_map(tmp_path / "robot.xml", normalized=True)


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
