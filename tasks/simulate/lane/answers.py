"""What applications answer in a control step, checked once before anything is compiled: what it is, and must be."""

from collections.abc import Mapping
from typing import Literal

import jax
import jax.numpy as jnp

from tasks.simulate.application.code import BundleCrash, CrashCode, function_place
from tasks.simulate.application.contract import State

_ROBOT: CrashCode = "RobotApplicationCrash"
_SCENARIO: CrashCode = "SimulationApplicationCrash"
_PAIR = 2
Kind = Literal["f", "i", "b"]
_KINDS: Mapping[Kind, str] = {"f": "float32", "i": "an integer", "b": "a bool"}
_VERDICT: Mapping[str, Kind] = {"goal_index": "i", "done": "b", "reason": "i"}


def robot_answer(answer: object, actuators: int, step: object) -> State:
    """Returns the state that a controller's step answers with, its control being one that can drive the robot.

    Args:
        answer: What the step returned, traced.
        actuators: How many numbers a control must have.
        step: The step, to say where it is.

    Raises:
        BundleCrash: It is no state with a control, or the control is no float32 for each actuator.
    """
    state, control = _pair(_ROBOT, "controller.step", answer, "the state and the control", step)
    if getattr(control, "shape", None) != (actuators,) or _kind(control) != "f":
        raise BundleCrash(
            _ROBOT,
            f"controller.step: control of shape {getattr(control, 'shape', None)} and {_named(control)}, "
            f"not ({actuators},) and float32{_at(step)}",
        )
    return state


def scenario_answer(answer: object, step: object) -> State:
    """Returns the state that a scenario's step answers with, its verdict being one.

    Args:
        answer: What the step returned, traced.
        step: The step, to say where it is.

    Raises:
        BundleCrash: It is no state with a verdict, or a field of the verdict is no scalar of its kind.
    """
    state, verdict = _pair(_SCENARIO, "scenario.step", answer, "the state and the verdict", step)
    for name, kind in _VERDICT.items():
        found = getattr(verdict, name, None)
        if getattr(found, "shape", None) != () or _kind(found) != kind:
            raise BundleCrash(
                _SCENARIO,
                f"scenario.step: verdict.{name} of shape {getattr(found, 'shape', None)} and {_named(found)}, "
                f"not () and {_KINDS[kind]}{_at(step)}",
            )
    return state


def require_same_form(code: CrashCode, name: str, before: State, after: State, step: object) -> None:
    """Checks that a step answers with a state of the form that it was given.

    Raises:
        BundleCrash: It does not.
    """

    def form(state: State) -> tuple[object, list[tuple[int, ...]]]:
        return jax.tree.structure(state), [leaf.shape for leaf in jax.tree.leaves(state)]

    if form(before) != form(after):
        raise BundleCrash(
            code,
            f"{name}.step: returns a state of another form than init: {form(after)}, not {form(before)}{_at(step)}",
        )


def _pair(code: CrashCode, name: str, answer: object, parts: str, step: object) -> tuple[State, object]:
    if not isinstance(answer, tuple) or len(answer) != _PAIR:
        kind = "nothing" if answer is None else type(answer).__name__
        found = f"a tuple of {len(answer)}" if isinstance(answer, tuple) else kind
        raise BundleCrash(code, f"{name}: returned {found}: must be {parts}, a tuple of {_PAIR}{_at(step)}")
    return answer


def _at(step: object) -> str:
    place = function_place(step)
    return f" ({place})" if place else ""


def _kind(found: object) -> str:
    dtype = getattr(found, "dtype", None)
    if dtype is None:
        return ""
    for kind, generic in (("b", jnp.bool_), ("i", jnp.integer)):
        if jnp.issubdtype(dtype, generic):
            return kind
    return "f" if dtype == jnp.float32 else ""


def _named(found: object) -> str:
    return str(getattr(found, "dtype", type(found).__name__))
