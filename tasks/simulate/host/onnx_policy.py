"""Policies in ONNX as the controllers of a chunk: all lanes' observations in, one answer for all of them out.

A network runs for all lanes in one call, such that a lane's answer does not depend on the other lanes. The numbers that
it answers with become controls: an action means here what it means to trainers. Actuators without a ``ctrlrange`` are
no part of an action: they are given 0. Nothing here imports JAX, so that a forecast can ask whether a policy fits.
"""

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int

from specs.bundle_files import ActionOutput, ChoiceOutput, PolicyPart
from specs.launched_file import policy_file
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import base_of, compile_robot
from tasks.simulate.host.policy_check import CheckedPolicy, RobotNumbers, check_policy

if TYPE_CHECKING:
    from tasks.simulate.application.contract import Observation
    from tasks.simulate.host.controllers import HostApplication, HostBundle, HostStart


class ControlRange(NamedTuple):
    """A robot's actuators.

    Attributes:
        numbers: How many there are, and how many coordinates the robot has.
        places: Of those that have a ``ctrlrange``.
        low, high: Their ranges.
    """

    numbers: RobotNumbers
    places: Int[np.ndarray, "ranged"]
    low: Float32[np.ndarray, "ranged"]
    high: Float32[np.ndarray, "ranged"]


def control_range(robot: Path) -> ControlRange:
    """Returns the actuators of a ``robot.xml``.

    Raises:
        RobotRefused: It does not load.
    """
    model = compile_robot(read_robot_mjcf(robot))
    places = np.flatnonzero(model.actuator_ctrllimited)
    low, high = model.actuator_ctrlrange[places].astype(np.float32).T
    articulated = base_of(model).articulated
    numbers = RobotNumbers(
        int(model.nu), len(places), int(model.nq) if articulated else 0, int(model.nv) if articulated else 0
    )
    return ControlRange(numbers, places, np.ascontiguousarray(low), np.ascontiguousarray(high))


def action_controls(
    ranges: ControlRange, actions: Float32[np.ndarray, "lanes ranged"]
) -> Float32[np.ndarray, "lanes actuators"]:
    """Returns the controls of actions from -1 to 1: ``middle + half * action``, clipped before."""
    middle, half = (ranges.high + ranges.low) / 2, (ranges.high - ranges.low) / 2
    return placed_controls(ranges, middle + half * np.clip(actions, np.float32(-1.0), np.float32(1.0)))


def placed_controls(
    ranges: ControlRange, values: Float32[np.ndarray, "lanes values"]
) -> Float32[np.ndarray, "lanes actuators"]:
    """Returns controls of one number for each actuator, or for each that has a ``ctrlrange``; the others are 0."""
    if values.shape[1] == ranges.numbers.actuators:
        return values
    controls = np.zeros((len(values), ranges.numbers.actuators), np.float32)
    controls[:, ranges.places] = values
    return controls


_ROBOT: CrashCode = "RobotApplicationCrash"
_FATAL = 4
# The lanes of every program are a multiple of it, on any machine.
_VECTOR = 8


# One thread runs it: the same sums in the same order on any number of cores. What an operator does to a row may
# follow from how many rows there are; whether it does is tried once, and such a network runs a vector of lanes at a
# time.
class Answers(NamedTuple):
    """What a network gives for all lanes.

    Attributes:
        output: Lanes first.
        states: What it keeps, lanes where each has them.
    """

    output: Float32[np.ndarray, "lanes ..."]
    states: list[Float32[np.ndarray, "..."]]


def require_onnxruntime() -> None:
    """Checks that what runs networks is installed.

    Raises:
        RobotRefused: It is not.
    """
    if importlib.util.find_spec("onnxruntime") is None:
        raise RobotRefused("a policy in ONNX needs onnxruntime: pip install 'simyard[onnx]'")


class LaneNetwork:
    """A network, loaded for a number of lanes.

    Raises:
        BundleCrash: It does not load or run, or a lane's answer follows from the other lanes.
    """

    def __init__(self, checked: CheckedPolicy, lanes: int) -> None:
        self._name, self._lanes, policy = checked.path.name, lanes, checked.policy
        self._inputs = [*(each.name or "" for each in policy.inputs), *(each.input for each in policy.states)]
        self._outputs = [policy.output.name or "", *(each.output for each in policy.states)]
        self._shapes = [(None, *shape) for shape in checked.input_shapes] + list(checked.state_shapes)
        self._axes = [shape.index(None) for shape in self._shapes]
        self._shown = len(policy.inputs)
        self._session: Any = call_bundle(_ROBOT, f"loading {self._name}", _session, checked.path.read_bytes())
        self._at_once = lanes
        self._at_once = self._safe_block()

    @property
    def lanes_at_once(self) -> int:
        """Returns how many lanes are run in one call."""
        return self._at_once

    def first_states(self) -> list[Float32[np.ndarray, "..."]]:
        """Returns what the network keeps before the first control step: zeros."""
        return [np.zeros(self._sized(shape), np.float32) for shape in self._shapes[self._shown :]]

    def answer(
        self, shown: Sequence[Float32[np.ndarray, "lanes numbers"]], states: Sequence[Float32[np.ndarray, "..."]]
    ) -> Answers:
        """Returns what the network gives.

        Args:
            shown: For each input, lanes first, flat.
            states: What it keeps.

        Raises:
            BundleCrash: It raises, or gives what has not the lanes' shape.
        """
        fed = [each.reshape(self._sized(shape)) for each, shape in zip(shown, self._shapes[: self._shown], strict=True)]
        return self._answer([*fed, *states])

    def _answer(self, fed: Sequence[Float32[np.ndarray, "..."]]) -> Answers:
        blocks = range(0, self._lanes, self._at_once)
        found = [self._run(self._block(fed, first)) for first in blocks]
        output, *states = (
            each[0] if len(each) == 1 else np.concatenate(each, axis=axis)
            for each, axis in zip(zip(*found, strict=True), self._output_axes(), strict=True)
        )
        return Answers(output, states)

    def _block(self, fed: Sequence[Float32[np.ndarray, "..."]], first: int) -> list[Float32[np.ndarray, "..."]]:
        if self._at_once == self._lanes:
            return list(fed)
        lanes = range(first, first + self._at_once)
        return [each.take(lanes, axis=axis) for each, axis in zip(fed, self._axes, strict=True)]

    def _run(self, fed: Sequence[Float32[np.ndarray, "..."]]) -> list[Float32[np.ndarray, "..."]]:
        feeds = dict(zip(self._inputs, fed, strict=True))
        found: list[np.ndarray] = call_bundle(_ROBOT, self._name, self._session.run, self._outputs, feeds)
        wanted = [None, *(self._sized(shape, self._at_once) for shape in self._shapes[self._shown :])]
        for name, array, shape in zip(self._outputs, found, wanted, strict=True):
            sound = array.shape[:1] == (self._at_once,) if shape is None else array.shape == shape
            if not sound or array.dtype != np.float32:
                told = f"({self._at_once}, ...)" if shape is None else shape
                raise BundleCrash(
                    _ROBOT, f"{self._name}: {name} of shape {array.shape} and {array.dtype}, not {told} and float32"
                )
        return found

    def _safe_block(self) -> int:
        """Returns how many lanes to run in one call: all, if a vector of lanes alone has the same bits.

        Raises:
            BundleCrash: A lane's answer follows from the other lanes.
        """
        rng = np.random.default_rng(0)
        fed, other = ([rng.standard_normal(self._sized(shape), np.float32) for shape in self._shapes] for _ in range(2))
        mixed = [
            np.where(_first_of_vectors(one, axis), one, two)
            for one, two, axis in zip(fed, other, self._axes, strict=True)
        ]
        together = self._answer(fed)
        self._at_once = _VECTOR
        apart, among = self._answer(fed), self._answer(mixed)
        if not self._same(apart, among, _VECTOR):
            raise BundleCrash(
                _ROBOT,
                f"{self._name}: a lane's answer follows from the other lanes, as with a mean over the batch: "
                "export the network for inference, as for one robot",
            )
        return self._lanes if self._same(together, apart, 1) else _VECTOR

    def _same(self, one: Answers, other: Answers, stride: int) -> bool:
        """Returns whether every so many lanes have the same bits in both."""
        pairs = zip((one.output, *one.states), (other.output, *other.states), self._output_axes(), strict=True)
        lanes = range(0, self._lanes, stride)
        return all(a.take(lanes, axis).tobytes() == b.take(lanes, axis).tobytes() for a, b, axis in pairs)

    def _output_axes(self) -> list[int]:
        return [0, *self._axes[self._shown :]]

    def _sized(self, shape: Sequence[int | None], lanes: int | None = None) -> tuple[int, ...]:
        return tuple(lanes or self._lanes if size is None else size for size in shape)


def _first_of_vectors(array: Float32[np.ndarray, "..."], axis: int) -> Bool[np.ndarray, "..."]:
    first = np.arange(array.shape[axis]) % _VECTOR == 0
    return first.reshape([-1 if place == axis else 1 for place in range(array.ndim)])


def _session(network: bytes) -> object:
    """Returns a session that runs on one thread, and that has no folder to find other files in."""
    import onnxruntime  # noqa: PLC0415 - an extra

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = _FATAL
    return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])


def onnx_application(bundle: "HostBundle") -> "HostApplication":
    """Returns the application of a bundle that has a network in ONNX in place of a module.

    Raises:
        BundleCrash: The network, its declaration or the robot is refused.
    """
    name = policy_file(bundle.launch.package, bundle.launch.launch_file)
    try:
        require_onnxruntime()
        ranges = control_range(bundle.robot)
        checked = check_policy(bundle.folder, name, ranges.numbers)
    except RobotRefused as refused:
        raise BundleCrash(_ROBOT, f"{bundle.launch.name}: {refused}") from refused
    from tasks.simulate.host.controllers import HostApplication, with_color  # noqa: PLC0415 - it imports JAX

    def declare(_: object) -> object:
        return checked.policy

    return HostApplication(
        "onnx", declare, lambda start: with_color(OnnxPolicies(checked, ranges, start), declare, start, bundle.robot)
    )


class OnnxPolicies:
    """The one network of a chunk's lanes, and what it keeps of each; what it raises is why all lanes crashed.

    Attributes:
        crashes: Why, by lane.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(self, checked: CheckedPolicy, ranges: ControlRange, start: "HostStart") -> None:
        self.crashes: dict[int, str] = {}
        self._policy, self._ranges, self._width = checked.policy, ranges, start.width
        self._network: LaneNetwork | None = None
        self._frames: dict[tuple[int, int], Float32[np.ndarray, "lanes frames numbers"]] = {}
        try:
            self._network = LaneNetwork(checked, start.width)
            self._states = self._network.first_states()
        except BundleCrash as crash:
            self.crashes.update(dict.fromkeys(range(len(start.lanes)), crash.reason))

    def controls(self, observed: "Observation", moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each lane's control; not a number for all of them if the network failed, now or before.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        nothing = np.full((self._width, self._ranges.numbers.actuators), np.nan, np.float32)
        if self._network is None:
            return nothing
        try:
            shown = [self._shown(number, each.parts, observed) for number, each in enumerate(self._policy.inputs)]
            output, self._states = self._network.answer(shown, self._states)
            return self._controls(output.reshape(self._width, -1))
        except BundleCrash as crash:
            self._network = None
            self.crashes.update(dict.fromkeys(np.flatnonzero(moving).tolist(), crash.reason))
            return nothing

    def measures(self, lane: int) -> Mapping[str, int]:  # noqa: ARG002 - as of all controllers on the host
        """Returns nothing: a row has all that there is."""
        return {}

    def close(self) -> None:
        """Lets go of the network."""
        self._network = None

    def _shown(
        self, number: int, parts: tuple[PolicyPart, ...], observed: "Observation"
    ) -> Float32[np.ndarray, "lanes numbers"]:
        """Returns what an input is shown of all lanes, lanes first, flat."""
        joints = {} if observed.joints is None else observed.joints._asdict()
        fields = observed._asdict() | joints
        values = [
            self._framed((number, place), part, _scaled(part, fields[part.field])) for place, part in enumerate(parts)
        ]
        return np.concatenate(values, axis=1)

    def _framed(
        self, place: tuple[int, int], part: PolicyPart, values: Float32[np.ndarray, "lanes numbers"]
    ) -> Float32[np.ndarray, "lanes frames*numbers"]:
        """Returns a part of the last control steps; all lanes of a chunk begin together."""
        if part.frames == 1:
            return values
        before = self._frames.get(place, np.repeat(values[:, None], part.frames, axis=1))
        self._frames[place] = np.concatenate([before[:, 1:], values[:, None]], axis=1)
        return self._frames[place].reshape(len(values), -1)

    def _controls(self, answer: Float32[np.ndarray, "lanes numbers"]) -> Float32[np.ndarray, "lanes nu"]:
        meant, ranges = self._policy.output, self._ranges
        numbers = answer.shape[1]
        if isinstance(meant, ChoiceOutput):
            self._require(numbers, {len(meant.controls)})
            chosen = np.asarray(meant.controls, np.float32)[np.argmax(answer, axis=1)]
            # A score that is no number would be the highest.
            chosen[~np.isfinite(answer).all(axis=1)] = np.nan
            return placed_controls(ranges, chosen)
        if isinstance(meant, ActionOutput):
            self._require(numbers, {ranges.numbers.ranged})
            return action_controls(ranges, answer)
        self._require(numbers, {ranges.numbers.ranged, ranges.numbers.actuators})
        return placed_controls(ranges, answer)

    def _require(self, numbers: int, allowed: set[int]) -> None:
        if numbers not in allowed:
            wanted = " or ".join(map(str, sorted(allowed)))
            raise BundleCrash(_ROBOT, f"{self._policy.output.name}: {numbers} numbers a lane, not {wanted}")


def _scaled(part: PolicyPart, field: np.ndarray) -> Float32[np.ndarray, "lanes numbers"]:
    values = np.asarray(field, np.float32).reshape(len(field), -1)
    if (part.scale, part.offset) != (1.0, 0.0):
        values = values * np.float32(part.scale) + np.float32(part.offset)
    return values if part.low is None and part.high is None else np.clip(values, _bound(part.low), _bound(part.high))


def _bound(value: float | None) -> np.float32 | None:
    return None if value is None else np.float32(value)
