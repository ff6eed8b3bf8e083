"""The two applications of a chunk: how the program calls them, and what their outputs are checked for.

The checks run once, before anything is compiled: what an application returns in a control step, and must return.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, cast

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle, function_place
from tasks.simulate.application.contract import Controller, FloorMap, Joints, Observation, Scenario, State, Truth
from tasks.simulate.sensors.lidar import Lidar
from tasks.simulate.sensors.sensor_table import (
    COLOR_CAMERA,
    Sensors,
    blank_fields,
    read_sensors,
    require_shared,
    sensors_of,
)

_ROBOT: CrashCode = "RobotApplicationCrash"
_SCENARIO: CrashCode = "SimulationApplicationCrash"
_PAIR = 2
Kind = Literal["f", "i", "b"]
_KINDS: Mapping[Kind, str] = {"f": "float32", "i": "an integer", "b": "a bool"}
_VERDICT: Mapping[str, Kind] = {"goal_index": "i", "done": "b", "reason": "i"}


def robot_output(answer: object, actuators: int, step: object) -> State:
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


def scenario_output(answer: object, step: object) -> State:
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


Numbers = Float[jax.Array, "variables"]
_METRIC = re.compile("[a-z][a-z0-9_]{0,62}")


@dataclass(frozen=True, eq=False)
class Applications:
    """Robot application and scenario of a program.

    Attributes:
        texts: Environment variables that are no numbers.
        names: Names of the numeric ones; their values come with each lane.
        sensors: As the robot application defines them; ``lane_sensors`` has a lane's own.
        identity: What all of this follows from, so that what was traced of it can be kept; empty if nobody can tell.
    """

    make_controller: Callable[..., object]
    make_scenario: Callable[..., object]
    texts: Mapping[str, str]
    names: tuple[str, ...]
    sensors: Sensors
    identity: str = ""

    @property
    def lidar(self) -> Lidar:
        """Returns the lidar: its rays, range, height and field of view, which all lanes share."""
        return self.sensors.lidar

    @property
    def looks(self) -> bool:
        """Returns whether the robot looks at all heights, so that what can be seen of its worlds is staged."""
        looking = (self.sensors.depth_camera, self.sensors.range_finders, self.sensors.cliff_sensors)
        return any(each is not None for each in looking)

    def lane_sensors(self, numbers: Numbers) -> Sensors:
        """Returns the sensors for one lane's numeric variables; their numbers may be traced."""
        return sensors_of(self.controller(numbers))

    def episode_sensors(self, environment: Mapping[str, object]) -> Sensors:
        """Returns the sensors of one episode in plain numbers.

        Raises:
            BundleCrash: They cannot be, or differ from its program's in what must be shared.
        """
        sensors = read_sensors(self.make_controller, environment)
        require_shared(self.sensors, sensors)
        return sensors

    def controller(self, numbers: Numbers) -> Controller:
        """Returns the controller for one lane's numeric variables, which may be traced."""
        return cast("Controller", self.make_controller({**self.texts, **dict(zip(self.names, numbers, strict=True))}))

    def scenario(self, numbers: Numbers) -> Scenario:
        """Returns the scenario for one lane's numeric variables, which may be traced."""
        return cast("Scenario", self.make_scenario({**self.texts, **dict(zip(self.names, numbers, strict=True))}))

    def metrics(self, numbers: Numbers, state: State) -> dict[str, Float[jax.Array, ""]]:
        """Returns what a lane's scenario measures by itself, by name; nothing for a scenario without ``metrics``."""
        measure = getattr(self.scenario(numbers), "metrics", None)
        return {} if measure is None else {name: jnp.asarray(value) for name, value in dict(measure(state)).items()}

    def placing_scenario(self, environment: Mapping[str, object]) -> Scenario:
        """Returns the scenario for one episode's variables, to draw its start and goals.

        Raises:
            BundleCrash: It cannot be made.
        """
        return cast("Scenario", call_bundle(_SCENARIO, "scenario(environment)", self.make_scenario, environment))


def check_robot(
    applications: Applications,
    floor: FloorMap,
    goals_m: jax.Array,
    numbers: Numbers,
    nu: int,
    *,
    joints: Joints | None = None,
) -> None:
    """Traces one lane's controller.

    Args:
        applications: With the controller.
        floor: One lane's map.
        goals_m: Its goals.
        numbers: Its numeric environment variables.
        nu: How many numbers a control has.
        joints: Of a robot that is more than a planar base.

    Raises:
        BundleCrash: It raises, changes the form of its state, or returns another number of controls.
    """
    observation = _blank_observation(applications.sensors, joints)

    def begin() -> State:
        return controller.init(floor, goals_m)

    def advance(state: State) -> object:
        return controller.step(state, observation)

    controller = call_bundle(_ROBOT, "controller(environment)", applications.controller, numbers)
    if getattr(controller, COLOR_CAMERA, None) is not None:
        raise BundleCrash(
            _ROBOT,
            f"controller.{COLOR_CAMERA}: pictures in colour are drawn on the host, and this controller is compiled: "
            "let its module say jax = False, or declare a depth_camera",
        )
    before = call_bundle(_ROBOT, "controller.init", jax.eval_shape, begin)
    after = robot_output(call_bundle(_ROBOT, "controller.step", jax.eval_shape, advance, before), nu, controller.step)
    require_same_form(_ROBOT, "controller", before, after, controller.step)


def check_scenario(
    applications: Applications, goals_m: jax.Array, numbers: Numbers, given: tuple[jax.Array, ...]
) -> None:
    """Traces one lane's scenario.

    Args:
        applications: With the scenario.
        goals_m: One lane's goals.
        numbers: Its numeric environment variables.
        given: What the scenario's ``place`` gave besides.

    Raises:
        BundleCrash: It raises, changes the form of its state, or has metrics that are no scalars by name.
    """
    zero, no = jnp.zeros(()), jnp.zeros((), bool)
    truth = Truth(zero, jnp.zeros(3), jnp.zeros(3), zero, zero, no)

    def begin() -> State:
        return scenario.init(jnp.zeros(3), goals_m, *given)

    def advance(state: State) -> object:
        return scenario.step(state, truth)

    scenario = call_bundle(_SCENARIO, "scenario(environment)", applications.scenario, numbers)
    before = call_bundle(_SCENARIO, "scenario.init", jax.eval_shape, begin)
    answer = call_bundle(_SCENARIO, "scenario.step", jax.eval_shape, advance, before)
    require_same_form(_SCENARIO, "scenario", before, scenario_output(answer, scenario.step), scenario.step)
    metrics = call_bundle(_SCENARIO, "scenario.metrics", jax.eval_shape, applications.metrics, numbers, before)
    for name, value in metrics.items():
        if not _METRIC.fullmatch(name) or getattr(value, "shape", None) != ():
            raise BundleCrash(
                _SCENARIO,
                f"scenario.metrics: {name!r} of shape {getattr(value, 'shape', None)}: must be scalars with names of "
                "lower-case letters, digits and underscores",
            )


def _blank_observation(sensors: Sensors, joints: Joints | None) -> Observation:
    return Observation(
        time_s=jnp.zeros(()),
        pose=jnp.zeros(3),
        velocity=jnp.zeros(3),
        goal_index=jnp.zeros((), jnp.int32),
        goal_m=jnp.zeros(2),
        goal_robot_m=jnp.zeros(2),
        joints=joints,
        **blank_fields(sensors),
    )
