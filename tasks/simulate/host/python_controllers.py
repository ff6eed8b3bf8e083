"""Runs controllers that are plain Python: lane by lane, each lane with an object of its own, or for all lanes at once.

The latter suit a network in torch, or a table in NumPy.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import jax
import numpy as np
from jaxtyping import Bool, Float32

from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle, load_factory
from tasks.simulate.application.contract import HostMap, Observation
from tasks.simulate.host.controllers import HostApplication, HostBundle, HostStart, real_control
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensors.sensor_table import Sensors, read_sensors

_ROBOT: CrashCode = "RobotApplicationCrash"


def plain_application(bundle: HostBundle) -> HostApplication:
    """Returns the application of a module that says ``jax = False``.

    Raises:
        BundleCrash: The module does not import, or has no ``controller``.
    """
    make = load_factory(bundle.folder, bundle.launch, "controller", _ROBOT)
    return HostApplication("plain", make, lambda start: PlainControllers(make, start))


class PlainControllers:
    """The controllers of a chunk's lanes; what one of them raises is why its own lane crashed.

    Attributes:
        crashes: Why, by lane.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(self, make_controller: Callable[..., object], start: HostStart) -> None:
        self.crashes: dict[int, str] = {}
        self._make, self._sensors, self._actuators = make_controller, start.sensors, start.actuators
        self._controllers = [self._begun(number, lane) for number, lane in enumerate(start.lanes)]

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control; not a number for a lane whose controller crashed, now or before.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        controls = np.zeros((len(moving), self._actuators), np.float32)
        for lane in np.flatnonzero(moving).tolist():
            own = cast("Observation", jax.tree.map(lambda array, lane=lane: array[lane], observed))
            controls[lane] = self._control(lane, own)
        return controls

    def measures(self, lane: int) -> Mapping[str, int]:  # noqa: ARG002 - as of all controllers on the host
        """Returns nothing: a row has all that there is."""
        return {}

    def close(self) -> None:
        """Does nothing: the controllers hold nothing."""

    def _begun(self, number: int, lane: Lane) -> Any:  # noqa: ANN401 - whatever a bundle makes
        numbers, texts = split_environment(lane.request.environment)
        environment = {**texts, **numbers}
        try:
            _require_same(self._sensors, read_sensors(self._make, environment))
            made: Any = call_bundle(_ROBOT, "controller(environment)", self._make, environment)
            floor = HostMap(*(array.copy() for array in lane.arrays.floor))  # one that it may write to
            call_bundle(_ROBOT, "controller.reset", lambda: made.reset(floor, lane.placement.goals_m))
        except BundleCrash as crash:
            self.crashes[number] = crash.reason
            return None
        return made

    def _control(self, lane: int, observation: Observation) -> Float32[np.ndarray, "nu"]:
        nothing = np.full(self._actuators, np.nan, np.float32)
        if self._controllers[lane] is None:
            return nothing
        try:
            control = call_bundle(_ROBOT, "controller.step", lambda: self._controllers[lane].step(observation))
            control = real_control("controller.step", control, (self._actuators,))
        except BundleCrash as crash:
            self.crashes[lane] = crash.reason
            return nothing
        return control


def _require_same(program: Sensors, episode: Sensors) -> None:
    if program != episode:
        raise BundleCrash(_ROBOT, "the sensors of a plain Python controller must not follow from a numeric variable")


def batched_application(bundle: HostBundle) -> HostApplication:
    """Returns the application of a module that defines ``controllers(environments)``.

    Raises:
        BundleCrash: The module does not import.
    """
    make = load_factory(bundle.folder, bundle.launch, "controllers", _ROBOT)
    return HostApplication(
        "batched", lambda environment: make([environment]), lambda start: BatchedControllers(make, start)
    )


class BatchedControllers:
    """The one controller of a chunk's lanes; what it raises is why all lanes crashed that still moved.

    Attributes:
        crashes: Why, by lane.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(self, make_controllers: Callable[..., object], start: HostStart) -> None:
        self.crashes: dict[int, str] = {}
        self._shape = (start.width, start.actuators)
        filled = [*start.lanes, *[start.lanes[0]] * (start.width - len(start.lanes))]
        self._controllers: Any = None
        try:
            self._controllers = self._begun(make_controllers, start, filled)
        except BundleCrash as crash:
            self.crashes.update(dict.fromkeys(range(len(start.lanes)), crash.reason))

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control; not a number for all of them if the controller crashed.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        nothing = np.full(self._shape, np.nan, np.float32)
        if self._controllers is None:
            return nothing
        try:
            control = call_bundle(_ROBOT, "controllers.step", lambda: self._controllers.step(observed))
            return real_control("controllers.step", control, self._shape)
        except BundleCrash as crash:
            self._controllers = None
            self.crashes.update(dict.fromkeys(np.flatnonzero(moving).tolist(), crash.reason))
            return nothing

    def measures(self, lane: int) -> Mapping[str, int]:  # noqa: ARG002 - as of all controllers on the host
        """Returns nothing: a row has all that there is."""
        return {}

    def close(self) -> None:
        """Does nothing: the controller holds nothing that outlives it."""

    def _begun(self, make: Callable[..., object], start: HostStart, filled: Sequence[Lane]) -> object:
        environments = [_variables(lane) for lane in filled]
        for environment in environments[: len(start.lanes)]:
            if read_sensors(lambda _, own=environment: make([own]), environment) != start.sensors:
                raise BundleCrash(_ROBOT, "the sensors of controllers must not follow from a numeric variable")
        made: Any = call_bundle(_ROBOT, "controllers(environments)", make, environments)
        floors, goals_m = [lane.arrays.floor for lane in filled], [lane.placement.goals_m for lane in filled]
        call_bundle(_ROBOT, "controllers.reset", lambda: made.reset(floors, goals_m))
        return made


def _variables(lane: Lane) -> dict[str, str | float]:
    numbers, texts = split_environment(lane.request.environment)
    return {**texts, **numbers}
