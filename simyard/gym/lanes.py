"""The lanes behind an environment: made once, stepped and begun anew, with spaces, checks and infos of Gymnasium."""
# ruff: noqa: PLC0415 - what runs lanes is imported once an environment is made: JAX reads its settings when imported

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from gymnasium import error, spaces

from simyard.gym.task_options import TaskOptions, task_of, view_of

if TYPE_CHECKING:
    from tasks.simulate.training.observation import FieldBounds

# The process that JAX runs in: a fork of it would wait for ever for threads that it has not.
_jax_process: list[int] = []
Observation = np.ndarray | dict[str, np.ndarray]
Info = dict[str, Any]


class Step(NamedTuple):
    """What a control step of all lanes gives, lanes first."""

    observation: Observation
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


class EnvironmentLanes:
    """Lanes of one environment.

    Attributes:
        count: How many.
        observation_space, action_space: Of one lane.
        control_names: Names of the actuators that an action drives.
    """

    def __init__(self, count: int, options: TaskOptions, *, autoreset: bool) -> None:
        from tasks.simulate.devices import prepare_devices

        if not _jax_process:
            _jax_process.append(os.getpid())
        self._process = _jax_process[0]
        self._require_own_process()
        prepare_devices()
        from tasks.simulate.training.training_lanes import TrainingLanes
        from tasks.simulate.training.training_program import training_program

        if count < 1:
            raise error.Error(f"num_envs: {count}: must be at least 1")
        engine = options.get("engine", "auto")
        program = training_program(task_of(options), view_of(options), count, autoreset=autoreset, engine=engine)
        self.count, self._flat = count, bool(options.get("flatten", False))
        self._lanes, self._begun = TrainingLanes(program, count), False
        actions = program.actions
        self.control_names = actions.names
        self.action_space = spaces.Box(actions.least, actions.most, dtype=np.float32)
        self._fields = dict(program.bounds)
        self.observation_space = _flat_space(self._fields) if self._flat else _dict_space(self._fields)
        self._requests = program.pool.requests
        self._worlds = np.array([each.world for each in self._requests], object)
        self._seeds = np.array([each.seed for each in self._requests], np.int64)

    @property
    def begun(self) -> bool:
        """Returns whether there was a reset."""
        return self._begun

    def reset(self, marked: np.ndarray, seeds: Sequence[int | None]) -> Observation:
        """Begins episodes of the marked lanes, and returns all observations.

        Args:
            marked: Which lanes.
            seeds: New ones; None for a lane that goes on with the next episode of its own.
        """
        self._require_own_process()
        negative = [seed for seed in seeds if seed is not None and seed < 0]
        if negative:
            raise error.Error(f"seed: {negative[0]}: must be at least 0")
        self._begun = True
        return self._shown(self._lanes.reset(marked, seeds))

    def step(self, actions: object) -> Step:
        """Drives all lanes a control step.

        Raises:
            ResetNeeded: There was no reset.
            InvalidAction: The actions have another shape, or are no finite numbers.
        """
        self._require_own_process()
        if not self._begun:
            raise error.ResetNeeded("step before reset: call reset first")
        result = self._lanes.step(self._checked(actions))
        return Step(
            self._shown(result.observation), result.reward.astype(np.float64), result.terminated, result.truncated
        )

    def beginnings(self) -> dict[str, np.ndarray]:
        """Returns which episodes the lanes are in: their world and seed, as a batch has them."""
        episodes = self._lanes.episodes()
        return {"world": self._worlds[episodes], "seed": self._seeds[episodes]}

    def endings(self) -> dict[str, np.ndarray]:
        """Returns how the lanes' episodes stand, under the names that results have."""
        from tasks.simulate.application.contract import REASONS

        ends = self._lanes.ends()
        return {
            "passed": ends.reason == 0,
            "reason": np.array(REASONS, object)[ends.reason],
            "goals_reached": ends.goals_reached.astype(np.int64),
            "simulated_s": ends.simulated_s.astype(np.float64),
            "path_length_m": ends.path_length_m.astype(np.float64),
            "collisions": ends.collisions.astype(np.int64),
        }

    def _checked(self, actions: object) -> np.ndarray:
        array = np.asarray(actions)
        shape = (self.count, *(self.action_space.shape or ()))
        if array.dtype.kind not in "fiu" or array.shape != shape:
            raise error.InvalidAction(f"actions: {array.dtype} of shape {array.shape}: must be real numbers, {shape}")
        wrong = np.argwhere(~np.isfinite(array))
        if len(wrong):
            place = ", ".join(map(str, wrong[0]))
            raise error.InvalidAction(f"actions[{place}]: {array[tuple(wrong[0])]}: must be a finite number")
        return array.astype(np.float32)

    def _shown(self, fields: dict[str, np.ndarray]) -> Observation:
        if not self._flat:
            return {name: fields[name] for name in self.observation_space.spaces}  # pyright: ignore[reportAttributeAccessIssue] - a Dict unless flat
        return self._lanes.seen

    def _require_own_process(self) -> None:
        if os.getpid() != self._process:
            raise error.Error(
                f"environments were made in process {self._process} before, and JAX does not survive a fork: make them "
                "in the process that steps them, such as with AsyncVectorEnv(..., context='spawn'); SimyardVectorEnv "
                "needs no processes to be fast"
            )


def lane_of(observation: Observation, lane: int) -> Observation:
    """Returns one lane's observation."""
    if isinstance(observation, dict):
        return {name: each[lane] for name, each in observation.items()}
    return observation[lane]


def marked_infos(values: dict[str, np.ndarray], marked: np.ndarray) -> Info:
    """Returns values of the marked lanes in Gymnasium's form for vectors: an array each, and beside it who has it."""
    infos: Info = {}
    for name, each in values.items():
        shown = np.full(each.shape, None, object) if each.dtype == object else np.zeros_like(each)
        shown[marked] = each[marked]
        infos[name], infos[f"_{name}"] = shown, marked.copy()
    return infos


def lane_info(values: dict[str, np.ndarray], lane: int) -> Info:
    """Returns one lane's values as plain Python ones, in Gymnasium's form for a single environment."""
    return {name: each[lane] if each.dtype == object else each[lane].item() for name, each in values.items()}


def _dict_space(fields: "dict[str, FieldBounds]") -> spaces.Dict:
    return spaces.Dict({name: spaces.Box(each.low, each.high, dtype=np.float32) for name, each in fields.items()})


def _flat_space(fields: "dict[str, FieldBounds]") -> spaces.Box:
    low, high = (np.concatenate([np.ravel(each[side]) for each in fields.values()]) for side in (0, 1))
    return spaces.Box(low, high, dtype=np.float32)
