"""The two applications of a chunk: how the program calls them, and checks before anything is compiled."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.application.code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.contract import (
    Controller,
    FloorMap,
    Joints,
    Observation,
    Scenario,
    State,
    Truth,
)
from tasks.simulate.lane.answers import require_same_form, robot_answer, scenario_answer
from tasks.simulate.sensor.lidar import Lidar
from tasks.simulate.sensor.sensors import Sensors, blank_fields, read_sensors, require_shared, sensors_of

Numbers = Float[jax.Array, "variables"]
_ROBOT: CrashCode = "RobotApplicationCrash"
_SCENARIO: CrashCode = "SimulationApplicationCrash"
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
    before = call_bundle(_ROBOT, "controller.init", jax.eval_shape, begin)
    after = robot_answer(call_bundle(_ROBOT, "controller.step", jax.eval_shape, advance, before), nu, controller.step)
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
    require_same_form(_SCENARIO, "scenario", before, scenario_answer(answer, scenario.step), scenario.step)
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
