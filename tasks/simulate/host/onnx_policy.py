"""Policies in ONNX as the controllers of a chunk: all lanes' observations in, one answer for all of them out."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float32

from specs.bundle_files import ActionOutput, ChoiceOutput, PolicyPart
from specs.launched_file import policy_file
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode
from tasks.simulate.application.contract import Observation
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.controllers import HostApplication, HostBundle, HostStart
from tasks.simulate.host.policy_check import CheckedPolicy, check_policy
from tasks.simulate.host.policy_network import (
    ControlRange,
    LaneNetwork,
    action_controls,
    control_range,
    placed_controls,
    require_onnxruntime,
)

_ROBOT: CrashCode = "RobotApplicationCrash"


def onnx_application(bundle: HostBundle) -> HostApplication:
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
    return HostApplication("onnx", lambda _: checked.policy, lambda start: OnnxPolicies(checked, ranges, start))


class OnnxPolicies:
    """The one network of a chunk's lanes, and what it keeps of each; what it raises is why all lanes crashed.

    Attributes:
        crashes: Why, by lane.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(self, checked: CheckedPolicy, ranges: ControlRange, start: HostStart) -> None:
        self.crashes: dict[int, str] = {}
        self._policy, self._ranges, self._width = checked.policy, ranges, start.width
        self._network: LaneNetwork | None = None
        try:
            self._network = LaneNetwork(checked, start.width)
            self._states = self._network.first_states()
        except BundleCrash as crash:
            self.crashes.update(dict.fromkeys(range(len(start.lanes)), crash.reason))

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each lane's control; not a number for all of them if the network failed, now or before.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        nothing = np.full((self._width, self._ranges.numbers.actuators), np.nan, np.float32)
        if self._network is None:
            return nothing
        try:
            shown = [_shown(each.parts, observed) for each in self._policy.inputs]
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


def _shown(parts: tuple[PolicyPart, ...], observed: Observation) -> Float32[np.ndarray, "lanes numbers"]:
    """Returns what an input is shown of all lanes, lanes first, flat."""
    joints = {} if observed.joints is None else observed.joints._asdict()
    fields = observed._asdict() | joints
    return np.concatenate([_scaled(part, fields[part.field]) for part in parts], axis=1)


def _scaled(part: PolicyPart, field: np.ndarray) -> Float32[np.ndarray, "lanes numbers"]:
    values = np.asarray(field, np.float32).reshape(len(field), -1)
    if (part.scale, part.offset) != (1.0, 0.0):
        values = values * np.float32(part.scale) + np.float32(part.offset)
    return values if part.low is None and part.high is None else np.clip(values, _bound(part.low), _bound(part.high))


def _bound(value: float | None) -> np.float32 | None:
    return None if value is None else np.float32(value)
