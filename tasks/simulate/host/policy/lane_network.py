"""Runs a network in ONNX for all lanes in one call, such that a lane's answer does not depend on the other lanes.

One thread runs it: the same sums in the same order on any number of cores. What an operator does to a row may follow
from how many rows there are; whether it does is tried once, and such a network runs a vector of lanes at a time.
"""

import importlib.util
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from tasks.simulate.application.code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.host.policy.policy_check import CheckedPolicy
from tasks.simulate.refusal import RobotRefused

_ROBOT: CrashCode = "RobotApplicationCrash"
_FATAL = 4
# The lanes of every program are a multiple of it, on any machine.
_VECTOR = 8


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
