"""Runs controllers that are plain Python: on the host, lane by lane, each lane with an object of its own.

A module that says ``jax = False`` may do in its controller whatever Python can: branch, keep lists, run an ONNX file.
In the compiled functions around it a stand-in has its place.
"""

from collections.abc import Callable, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32

from tasks.simulate.application.code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.contract import Observation
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensor.sensors import SENSORS, Sensors, read_sensors

_ROBOT: CrashCode = "RobotApplicationCrash"
# Floats and integers: what a person writes in Python for a number.
_REAL_KINDS = "fiu"


class StandIn:
    """What compiled functions see of a plain controller: its sensors, no state, and a control that nobody uses."""

    def __init__(self, sensors: Sensors, actuators: int) -> None:
        for sensor, declared in zip(SENSORS, sensors, strict=True):
            setattr(self, sensor.name, None if declared == sensor.absent else declared)
        self._actuators = actuators

    def init(self, floor: object, goals_m: object) -> tuple[()]:  # noqa: ARG002 - as every controller is called
        """Returns no state."""
        return ()

    def step(self, state: tuple[()], observation: object) -> tuple[tuple[()], Float[jax.Array, "actuators"]]:  # noqa: ARG002 - as every controller is called
        """Returns no state, and no control to speak of."""
        return state, jnp.zeros(self._actuators)


class PlainControllers:
    """The controllers of a chunk's lanes; what one of them raises is why its own lane crashed.

    Attributes:
        crashes: Why, by lane.
    """

    def __init__(
        self, make_controller: Callable[..., object], sensors: Sensors, actuators: int, lanes: Sequence[Lane]
    ) -> None:
        self.crashes: dict[int, str] = {}
        self._make, self._sensors, self._actuators = make_controller, sensors, actuators
        self._controllers = [self._begun(number, lane) for number, lane in enumerate(lanes)]

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

    def _begun(self, number: int, lane: Lane) -> Any:  # noqa: ANN401 - whatever a bundle makes
        numbers, texts = split_environment(lane.request.environment)
        environment = {**texts, **numbers}
        try:
            _require_same(self._sensors, read_sensors(self._make, environment))
            made: Any = call_bundle(_ROBOT, "controller(environment)", self._make, environment)
            call_bundle(_ROBOT, "controller.reset", lambda: made.reset(lane.stage.floor, lane.placement.goals_m))
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
            control = _real(call_bundle(_ROBOT, "controller.step", np.asarray, control))
            _require_shape(control, self._actuators)
        except BundleCrash as crash:
            self.crashes[lane] = crash.reason
            return nothing
        return control


def _require_same(program: Sensors, episode: Sensors) -> None:
    if program != episode:
        raise BundleCrash(_ROBOT, "the sensors of a plain Python controller must not follow from a numeric variable")


def _real(control: np.ndarray) -> Float32[np.ndarray, "*shape"]:
    if control.dtype.kind not in _REAL_KINDS:
        raise BundleCrash(_ROBOT, f"controller.step: control of {control.dtype}, not of real numbers")
    return control.astype(np.float32)


def _require_shape(control: Float32[np.ndarray, "*shape"], actuators: int) -> None:
    if control.shape != (actuators,):
        raise BundleCrash(_ROBOT, f"controller.step: control of shape {control.shape}, not ({actuators},)")
