"""The interface of controllers that run on the host, those that are plain Python, and the table of all kinds.

All lanes' observations go in, all lanes' controls come out. Between two control steps of the compiled functions the run
stops, asks these, and goes on. In the compiled functions a stand-in has the controller's place. Plain Python runs lane
by lane, each lane with an object of its own, or for all lanes at once, which suits a network in torch or a table in
NumPy. Kinds that need more are imported when an application of that kind is loaded.
"""
# ruff: noqa: PLC0415 - what a kind needs is imported when an application of that kind is loaded

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import ApplicationLaunch
from specs.data.world import World
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.contract import HostMap, Observation
from tasks.simulate.host.declaration import ROBOT_FILE, ControllerKind, load_controller
from tasks.simulate.host.ros_judge import Judgement
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensors.sensor_table import SENSORS, Sensors, read_color_camera, read_sensors

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
class TellsMetrics(Protocol):
    """Controllers that measure something themselves."""

    def metrics(self, lane: int) -> Mapping[str, float]:
        """Returns metrics of the lane's row, by name."""
        ...


@runtime_checkable
class TagsJobs(Protocol):
    """Controllers that may give tags to the jobs of their lanes."""

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns the tags that a lane's application gave to its job."""
        ...


@runtime_checkable
class JudgesJobs(Protocol):
    """Controllers whose lanes an application of ROS may judge."""

    def judgement(self, lane: int) -> Judgement | None:
        """Returns what a lane's application says of it; None where a scenario judges."""
        ...


@runtime_checkable
class BlamesCrashes(Protocol):
    """Controllers whose crashes may be another's than the robot application's."""

    def failure_code(self, lane: int) -> SimulationJobErrorCode:
        """Returns whose crash a lane's is."""
        ...


@runtime_checkable
class PlacesRobots(Protocol):
    """Controllers whose applications may set robots elsewhere."""

    @property
    def placed(self) -> Mapping[int, tuple[float, float, float]]:
        """Returns where robots were set while the last controls were found, (x m, y m, yaw rad), by lane."""
        ...


@runtime_checkable
class SeesWorlds(Protocol):
    """Controllers of robots with colour cameras: the host draws what these see."""

    @property
    def gl(self) -> str:
        """Returns which GL drew; empty if nothing was drawn."""
        ...

    def see(self, poses: Float32[np.ndarray, "lanes 3"]) -> None:
        """Tells where the robots truly are (x m, y m, yaw rad), before a control step."""
        ...

    def first_camera(self) -> ColorCameraDeclaration | None:
        """Returns the first lane's camera; None if nothing was drawn for it, or it could not be drawn to the end."""
        ...

    def drawn_again(
        self, steps: Int[np.ndarray, "pictures"], poses: Float32[np.ndarray, "pictures 3"]
    ) -> UInt8[np.ndarray, "pictures rows columns 3"]:
        """Returns what the first lane's camera saw when it took pictures, or what those of a list saw, in one column.

        Args:
            steps: Which.
            poses: Where its robot was.
        """
        ...


def drawn_by(host: HostControllers | None) -> str:
    """Returns which GL drew what controllers were shown; empty if none did."""
    return host.gl if isinstance(host, SeesWorlds) else ""


def asked_controls(
    host: HostControllers,
    observed: Observation,
    moving: Bool[np.ndarray, "lanes"],
    poses: Callable[[], np.ndarray],
) -> Float32[np.ndarray, "lanes nu"]:
    """Returns each moving lane's control, as ``HostControllers.controls``.

    Args:
        host: The controllers.
        observed: Of all lanes, lanes first, in NumPy.
        moving: Lanes that are not done.
        poses: Returns where the robots truly are, (lanes, 3); only asked for cameras.
    """
    if isinstance(host, SeesWorlds):
        host.see(poses())
    return host.controls(observed, moving)


def placed_poses(host: HostControllers, lanes: int) -> Float32[np.ndarray, "lanes 3"] | None:
    """Returns where robots are set before the control step to come, not a number for the others; None for nobody."""
    if not isinstance(host, PlacesRobots) or not host.placed:
        return None
    poses = np.full((lanes, 3), np.nan, np.float32)
    for lane, pose in host.placed.items():
        poses[lane] = pose
    return poses


class HostStart(NamedTuple):
    """What controllers of a chunk begin with.

    Attributes:
        lanes: The episodes, in the lanes' order.
        width: Lanes of the program; those beyond the episodes never move.
        actuators: How many numbers a control has.
        sensors: The program's.
        worlds: Those of the lanes, by name, for what the host draws.
    """

    lanes: Sequence[Lane]
    width: int
    actuators: int
    sensors: Sensors
    worlds: Mapping[str, World] = {}


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
    """Where a robot application lies, and how it is launched.

    Attributes:
        judge: The simulation application, if its nodes run beside it; the same where there is no robot application.
    """

    folder: Path
    launch: ApplicationLaunch
    judge: "HostBundle | None" = None

    @property
    def robot(self) -> Path:
        """Returns its ``robot.xml``."""
        return self.folder / ROBOT_FILE


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


# A module that says ``jax = False`` may do in its controller whatever Python can: branch, keep lists, look things up.
def plain_application(bundle: HostBundle) -> HostApplication:
    """Returns the application of a module that says ``jax = False``.

    Raises:
        BundleCrash: The module does not import, or has no ``controller``.
    """
    make = load_controller(bundle.folder, bundle.launch, "controller")

    def start(start: HostStart) -> HostControllers:
        return with_color(PlainControllers(make, start), make, start, bundle.robot)

    return HostApplication("plain", make, start)


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


# A module that says ``jax = False`` and defines ``controllers(environments)`` is asked once a control step, with the
# observations of all lanes, and keeps the state of all of them itself.
def batched_application(bundle: HostBundle) -> HostApplication:
    """Returns the application of a module that defines ``controllers(environments)``.

    Raises:
        BundleCrash: The module does not import.
    """
    make = load_controller(bundle.folder, bundle.launch, "controllers")

    def declare(environment: Mapping[str, object]) -> object:
        return make([environment])

    return HostApplication(
        "batched", declare, lambda start: with_color(BatchedControllers(make, start), declare, start, bundle.robot)
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


def with_color(
    controllers: HostControllers, declare: Callable[[Mapping[str, object]], object], start: HostStart, robot: Path
) -> HostControllers:
    """Returns controllers that are shown what their robots' colour cameras see, if these have any.

    Args:
        controllers: Of plain Python.
        declare: Returns an object that has an episode's camera as an attribute.
        start: What they began with.
        robot: The ``robot.xml``, which cameras may see.
    """
    found: list[ColorCameraDeclaration | BundleCrash | None] = []
    for lane in start.lanes:
        try:
            found.append(read_color_camera(declare, _variables(lane)))
        except BundleCrash as crash:
            found.append(crash)
    # A controller that raises in one lane takes no cameras away from the others, which have none.
    if None in found and not any(isinstance(each, ColorCameraDeclaration) for each in found):
        return controllers
    if any(lane.robots is not None for lane in start.lanes):
        raise BundleCrash(_ROBOT, "color_camera: what it sees of other robots in its world is not drawn yet")
    from tasks.simulate.host.color_cameras import LanePictures, SeeingControllers

    return SeeingControllers(controllers, LanePictures(found, start, robot), start)


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
    "plain": plain_application,
    "batched": batched_application,
    "onnx": _onnx,
    "ros": _ros,
    "ros2": _ros2,
}
