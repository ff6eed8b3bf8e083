"""The two applications of a chunk as the program calls them, checked before anything is compiled."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.bundles import BundleCrash, CrashCode, guarded
from tasks.simulate.contract import Controller, FloorMap, Lidar, Observation, Scenario, State, Truth, Verdict

Numbers = Float[jax.Array, "variables"]
_ROBOT: CrashCode = "RobotApplicationCrash"
_SCENARIO: CrashCode = "SimulationApplicationCrash"


@dataclass(frozen=True, eq=False)
class Applications:
    """Robot application and scenario of a program.

    Attributes:
        texts: Environment variables that are no numbers.
        names: Names of the numeric ones; their values come with each lane.
        lidar: As the robot application defines it.
    """

    make_controller: Callable[..., object]
    make_scenario: Callable[..., object]
    texts: Mapping[str, str]
    names: tuple[str, ...]
    lidar: Lidar

    def controller(self, numbers: Numbers) -> Controller:
        """Returns the controller for one lane's numeric variables, which may be traced."""
        return cast("Controller", self.make_controller({**self.texts, **dict(zip(self.names, numbers, strict=True))}))

    def scenario(self, numbers: Numbers) -> Scenario:
        """Returns the scenario for one lane's numeric variables, which may be traced."""
        return cast("Scenario", self.make_scenario({**self.texts, **dict(zip(self.names, numbers, strict=True))}))

    def placing_scenario(self, environment: Mapping[str, object]) -> Scenario:
        """Returns the scenario for one episode's variables, to draw its start and goals.

        Raises:
            BundleCrash: It cannot be made.
        """
        return cast("Scenario", guarded(_SCENARIO, "scenario(environment)", self.make_scenario, environment))


def read_lidar(make_controller: Callable[..., object], environment: Mapping[str, object]) -> Lidar:
    """Returns the lidar of a robot application.

    Raises:
        BundleCrash: The controller cannot be made, or has no usable ``lidar``.
    """
    made = guarded(_ROBOT, "controller(environment)", make_controller, environment)
    lidar = getattr(made, "lidar", None)
    try:
        rays, range_m, height_m = int(lidar.rays), float(lidar.range_m), float(lidar.height_m)  # pyright: ignore[reportOptionalMemberAccess] - None has no such attribute, which is caught
    except (AttributeError, TypeError, ValueError) as exc:
        raise BundleCrash(_ROBOT, f"controller.lidar: needs rays, range_m and height_m as numbers: {exc}") from exc
    if rays < 1 or range_m <= 0.0 or height_m < 0.0:
        raise BundleCrash(_ROBOT, f"controller.lidar: {rays} rays, {range_m} m range at {height_m} m: must be positive")
    return cast("Lidar", lidar)


def check_robot(applications: Applications, floor: FloorMap, goals_m: jax.Array, numbers: Numbers, nu: int) -> None:
    """Traces one lane's controller.

    Raises:
        BundleCrash: It raises, changes the form of its state, or returns another number of controls.
    """
    observation = Observation(
        time_s=jnp.zeros(()),
        pose=jnp.zeros(3),
        velocity=jnp.zeros(3),
        ranges_m=jnp.zeros(applications.lidar.rays),
        goal_index=jnp.zeros((), jnp.int32),
        goal_m=jnp.zeros(2),
    )

    def begin() -> State:
        return applications.controller(numbers).init(floor, goals_m)

    def advance(state: State) -> tuple[State, jax.Array]:
        return applications.controller(numbers).step(state, observation)

    before = guarded(_ROBOT, "controller.init", jax.eval_shape, begin)
    after, control = guarded(_ROBOT, "controller.step", jax.eval_shape, advance, before)
    _require_same_form(_ROBOT, "controller", before, after)
    if getattr(control, "shape", None) != (nu,):
        raise BundleCrash(_ROBOT, f"controller.step: control of shape {getattr(control, 'shape', None)}, not ({nu},)")


def check_scenario(applications: Applications, goals_m: jax.Array, numbers: Numbers) -> None:
    """Traces one lane's scenario.

    Raises:
        BundleCrash: It raises, or changes the form of its state.
    """
    zero, no = jnp.zeros(()), jnp.zeros((), bool)
    truth = Truth(zero, jnp.zeros(3), jnp.zeros(3), zero, zero, no)

    def begin() -> State:
        return applications.scenario(numbers).init(jnp.zeros(3), goals_m)

    def advance(state: State) -> tuple[State, Verdict]:
        return applications.scenario(numbers).step(state, truth)

    before = guarded(_SCENARIO, "scenario.init", jax.eval_shape, begin)
    after, _ = guarded(_SCENARIO, "scenario.step", jax.eval_shape, advance, before)
    _require_same_form(_SCENARIO, "scenario", before, after)


def _require_same_form(code: CrashCode, name: str, before: State, after: State) -> None:
    def form(state: State) -> tuple[object, list[tuple[int, ...]]]:
        return jax.tree.structure(state), [leaf.shape for leaf in jax.tree.leaves(state)]

    if form(before) != form(after):
        raise BundleCrash(
            code,
            f"{name}.step: returns a state of another form than init: {form(after)}, not {form(before)}",
        )
