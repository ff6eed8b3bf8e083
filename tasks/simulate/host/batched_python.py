"""Runs a controller that is plain Python for all lanes at once: a network in torch, a table in NumPy.

A module that says ``jax = False`` and defines ``controllers(environments)`` is asked once a control step, with the
observations of all lanes, and keeps the state of all of them itself.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32

from tasks.simulate.application.code import BundleCrash, CrashCode, call_bundle, load_factory
from tasks.simulate.application.contract import Observation
from tasks.simulate.host.controllers import HostApplication, HostBundle, HostStart
from tasks.simulate.host.host_control import real_control
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensor.sensors import read_sensors

_ROBOT: CrashCode = "RobotApplicationCrash"


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
        floors, goals_m = [lane.stage.floor for lane in filled], [lane.placement.goals_m for lane in filled]
        call_bundle(_ROBOT, "controllers.reset", lambda: made.reset(floors, goals_m))
        return made


def _variables(lane: Lane) -> dict[str, str | float]:
    numbers, texts = split_environment(lane.request.environment)
    return {**texts, **numbers}
