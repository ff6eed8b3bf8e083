"""The interface of controllers that run on the host, and the table of their kinds.

All lanes' observations go in, all lanes' controls come out. Between two control steps of the compiled functions the run
stops, asks these, and goes on. In the compiled functions a stand-in has the controller's place. A record of the table
says how an application of that kind is loaded; what loads it is imported then.
"""
# ruff: noqa: PLC0415 - what a kind needs is imported when an application of that kind is loaded

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32

from specs.data.episode import ApplicationLaunch
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.contract import Observation
from tasks.simulate.host.declaration import ControllerKind
from tasks.simulate.lane.staging import Lane
from tasks.simulate.sensors.sensor_table import SENSORS, Sensors

_ROBOT: CrashCode = "RobotApplicationCrash"
# Floats and integers: what a person writes in Python for a number.
_REAL_KINDS = "fiu"


class HostControllers(Protocol):
    """The controllers of a chunk's lanes."""

    @property
    def crashes(self) -> Mapping[int, str]:
        """Returns why controllers crashed, by lane."""
        ...

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose own application asked for the end of its job."""
        ...

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control; not a number for one that crashed or is cancelled, now or before.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        ...

    def measures(self, lane: int) -> Mapping[str, int]:
        """Returns fields of the lane's row that only its controller knows, such as ``late``."""
        ...

    def close(self) -> None:
        """Ends what the controllers hold: processes, ports, files. A second call does nothing."""
        ...


@runtime_checkable
class TagsJobs(Protocol):
    """Controllers that may give tags to the jobs of their lanes."""

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns the tags that a lane's application gave to its job."""
        ...


class HostStart(NamedTuple):
    """What controllers of a chunk begin with.

    Attributes:
        lanes: The episodes, in the lanes' order.
        width: Lanes of the program; those beyond the episodes never move.
        actuators: How many numbers a control has.
        sensors: The program's.
    """

    lanes: Sequence[Lane]
    width: int
    actuators: int
    sensors: Sensors


@dataclass(frozen=True, eq=False)
class HostApplication:
    """A robot application that runs on the host.

    Attributes:
        declare: Returns an object that has the robot's sensors as attributes, for given environment variables.
        start: Returns controllers for a chunk; what goes wrong with one lane's is its crash.
    """

    kind: ControllerKind
    declare: Callable[[Mapping[str, object]], object]
    start: Callable[[HostStart], HostControllers]


class HostBundle(NamedTuple):
    """Where a robot application lies, and how it is launched."""

    folder: Path
    launch: ApplicationLaunch

    @property
    def robot(self) -> Path:
        """Returns its ``robot.xml``."""
        return self.folder / "robot.xml"


class StandIn:
    """What compiled functions see of a controller on the host: its sensors, no state, a control that nobody uses."""

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


def real_control(doing: str, control: object, shape: tuple[int, ...]) -> Float32[np.ndarray, "*shape"]:
    """Returns a control as an array.

    Args:
        doing: Which function returned it, for a person.
        control: Whatever it returned.
        shape: That it must have.

    Raises:
        BundleCrash: It is no array of real numbers, or has another shape.
    """
    array = call_bundle(_ROBOT, doing, np.asarray, control)
    if array.dtype.kind not in _REAL_KINDS:
        raise BundleCrash(_ROBOT, f"{doing}: control of {array.dtype}, not of real numbers")
    if array.shape != shape:
        shown = f"({shape[0]},)" if len(shape) == 1 else str(shape)
        raise BundleCrash(_ROBOT, f"{doing}: control of shape {array.shape}, not {shown}")
    return array.astype(np.float32)


def _plain(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.python_controllers import plain_application

    return plain_application(bundle)


def _batched(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.python_controllers import batched_application

    return batched_application(bundle)


def _onnx(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.onnx_policy import onnx_application

    return onnx_application(bundle)


def _ros(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.ros_controllers import ros1_lockstep, ros_application

    return ros_application(bundle, "ros", ros1_lockstep)


def _ros2(bundle: HostBundle) -> HostApplication:
    from tasks.simulate.host.ros_controllers import ros2_lockstep, ros_application

    return ros_application(bundle, "ros2", ros2_lockstep)


HOST_KINDS: Mapping[ControllerKind, Callable[[HostBundle], HostApplication]] = {
    "plain": _plain,
    "batched": _batched,
    "onnx": _onnx,
    "ros": _ros,
    "ros2": _ros2,
}
