"""`SimyardVectorEnv`: hundreds of robots in as many episodes, a control step of all of them in one compiled call.

The lanes behind an environment are made once, stepped and begun anew, with spaces, checks and infos of Gymnasium.
"""
# ruff: noqa: PLC0415 - what runs lanes is imported once an environment is made: JAX reads its settings when imported

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
from gymnasium import error, spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from simyard.gym.task_options import TaskOptions, frames_of, task_of, view_of
from tasks.progress.listener import waiting_for

if TYPE_CHECKING:
    from tasks.simulate.training.training_spaces import FieldBounds

# The process that JAX runs in: a fork of it would wait for ever for threads that it has not.
_jax_process: list[int] = []
Observation = np.ndarray | dict[str, np.ndarray]
Info = dict[str, Any]
_MASK = "reset_mask"


class Step(NamedTuple):
    """What a control step of all lanes gives, lanes first."""

    observation: Observation
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


class _Stacks:
    """The last observations of all lanes, each lane's own one after the other, as in ``FrameStackObservation``."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._kept: dict[str, np.ndarray] = {}

    def begin(self, observation: Observation, marked: np.ndarray) -> Observation:
        """Returns stacks of the marked lanes that are full of what is seen, and the others as they are."""
        return self._each(observation, lambda kept, _: kept, marked)

    def step(self, observation: Observation, begun: np.ndarray) -> Observation:
        """Returns stacks with what is seen as their last, those of lanes that have begun full of it."""
        return self._each(observation, lambda kept, seen: np.concatenate([kept[:, 1:], seen[:, None]], axis=1), begun)

    def _each(
        self, observation: Observation, after: Callable[[np.ndarray, np.ndarray], np.ndarray], fresh: np.ndarray
    ) -> Observation:
        if not isinstance(observation, dict):
            return self._stacked("", observation, after, fresh)
        return {name: self._stacked(name, seen, after, fresh) for name, seen in observation.items()}

    def _stacked(
        self, name: str, seen: np.ndarray, after: Callable[[np.ndarray, np.ndarray], np.ndarray], fresh: np.ndarray
    ) -> np.ndarray:
        full = np.repeat(seen[:, None], self._frames, axis=1)
        kept = after(self._kept.get(name, full), seen).copy()
        kept[fresh] = full[fresh]
        self._kept[name] = kept
        return kept.copy()


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
        from tasks.simulate.training.training_program import TrainingLanes, training_program

        if count < 1:
            raise error.Error(f"num_envs: {count}: must be at least 1")
        engine = options.get("engine", "auto")
        program = training_program(task_of(options), view_of(options), count, autoreset=autoreset, engine=engine)
        self.count, self._flat = count, bool(options.get("flatten", False))
        self._lanes, self._begun, self._called = TrainingLanes(program, count), False, set[str]()
        actions = program.actions
        self.control_names = actions.names
        self.action_space = spaces.Box(actions.least, actions.most, dtype=np.float32)
        self._fields = dict(program.bounds)
        self.observation_space = _flat_space(self._fields) if self._flat else _dict_space(self._fields)
        self._stacks: _Stacks | None = None
        if (frames := frames_of(options)) is not None:
            self._stacks = _Stacks(frames)
            self.observation_space = batch_space(self.observation_space, frames)
        self._autoreset, self._over = autoreset, np.zeros(count, bool)
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
        with self._compiled("reset"):
            self._begun = True
            shown = self._shown(self._lanes.reset(marked, seeds))
        self._over = self._over & ~marked
        return self._stacks.begin(shown, marked) if self._stacks else shown

    def step(self, actions: object) -> Step:
        """Drives all lanes a control step.

        Raises:
            ResetNeeded: There was no reset.
            InvalidAction: The actions have another shape, or are no finite numbers.
        """
        self._require_own_process()
        if not self._begun:
            raise error.ResetNeeded("step before reset: call reset first")
        checked = self._checked(actions)
        with self._compiled("step"):
            result = self._lanes.step(checked)
        shown, begun = self._shown(result.observation), self._over
        if self._stacks:
            shown = self._stacks.step(shown, begun)
        self._over = (result.terminated | result.truncated) & self._autoreset
        return Step(shown, result.reward.astype(np.float64), result.terminated, result.truncated)

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

    def _compiled(self, call: str) -> AbstractContextManager[None]:
        """Says on stderr that a program is compiled, at the first call of its kind, if that takes long."""
        if call in self._called:
            return nullcontext()
        self._called.add(call)
        return waiting_for(f"the first {call} compiles its program", lambda line: print(line, file=sys.stderr))  # noqa: T201 - a trainer has no other place

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
            return {name: fields[name] for name in sorted(self._fields)}
        return np.concatenate([fields[name].reshape(self.count, -1) for name in self._fields], axis=1, dtype=np.float32)

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
    boxes: dict[str, spaces.Space[Any]] = {
        name: spaces.Box(each.low, each.high, dtype=each.low.dtype.type) for name, each in fields.items()
    }
    return spaces.Dict(boxes)


def _flat_space(fields: "dict[str, FieldBounds]") -> spaces.Box:
    low, high = (np.concatenate([np.ravel(each[side]) for each in fields.values()]) for side in (0, 1))
    return spaces.Box(low, high, dtype=np.float32)


class SimyardVectorEnv(VectorEnv[Any, np.ndarray, np.ndarray]):
    """Robots in worlds of Simyard, with the physics, sensors and verdicts of a batch.

    Sub-environment i of `reset(seed=s)` has the seed s + i; its k-th episode is drawn from the pool by that seed and k
    alone. Same seeds and actions, same bits, on any number of cores.

    Attributes:
        lanes: What steps them.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Unpack[TaskOptions],
    ) -> None:
        """Makes it.

        Args:
            num_envs: How many robots; a multiple of 8 for each core wastes none.
            autoreset_mode: When a sub-environment begins its next episode, as Gymnasium defines it.
            options: See ``TaskOptions``.

        Raises:
            DocumentError: An option is wrong, or names what there is not.
        """
        self.num_envs, self._mode = num_envs, AutoresetMode(autoreset_mode)
        self._options = options
        self.lanes = EnvironmentLanes(num_envs, options, autoreset=self._mode is AutoresetMode.NEXT_STEP)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = self.lanes.observation_space, self.lanes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Info]:
        """Begins episodes.

        Args:
            seed: s for seeds s, s + 1, ..., or a list of them, for the first episodes of these; None for the next
                episode of a sub-environment's own seed.
            options: ``reset_mask``, an array of bools, says which sub-environments begin; all, if left out.
        """
        self._require_open()
        if seed is None or isinstance(seed, int):
            super().reset(seed=seed)
        marked = _mask(options, self.num_envs)
        observation = self.lanes.reset(marked, self._seeds(seed, marked))
        self._over &= ~marked
        return observation, marked_infos(self.lanes.beginnings(), marked)

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, Info]:
        """Drives all robots a control step of 50 ms.

        Args:
            actions: One for each sub-environment; beyond the action space they are clipped.

        Raises:
            InvalidAction: They have another shape, or are no finite numbers.
            ResetNeeded: There was no reset; or, without autoreset, a sub-environment is over.
        """
        self._require_open()
        if self._mode is AutoresetMode.DISABLED and self._over.any():
            raise error.ResetNeeded(
                f"sub-environment {int(np.argmax(self._over))} is over: reset it first, with options['reset_mask']"
            )
        done = self.lanes.step(actions)
        begun, self._over = self._over, done.terminated | done.truncated
        observation, infos = done.observation, Info()
        if self._mode is AutoresetMode.NEXT_STEP and begun.any():
            infos = marked_infos(self.lanes.beginnings(), begun)
        if self._over.any() and self._mode is AutoresetMode.SAME_STEP:
            observation, infos = self._next_episodes(observation)
        elif self._over.any():
            infos |= marked_infos(self.lanes.endings(), self._over)
        return observation, done.reward, done.terminated, done.truncated, infos

    def _next_episodes(self, observation: Observation) -> tuple[Observation, Info]:
        """Returns the observations after those that are over have begun anew, and what they ended with."""
        over, final = self._over, np.full(self.num_envs, None, object)
        for lane in np.flatnonzero(over).tolist():
            final[lane] = lane_of(observation, lane)
        infos: Info = {"final_obs": final, "_final_obs": over.copy()}
        infos |= {"final_info": marked_infos(self.lanes.endings(), over), "_final_info": over.copy()}
        observation = self.lanes.reset(over, [None] * self.num_envs)
        infos |= marked_infos(self.lanes.beginnings(), over)
        self._over = np.zeros(self.num_envs, bool)
        return observation, infos

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns what makes it anew, before its first reset."""
        return _remade, (self.num_envs, self._mode, dict(self._options))

    def _seeds(self, seed: int | Sequence[int | None] | None, marked: np.ndarray) -> list[int | None]:
        if isinstance(seed, int):
            return [seed + lane for lane in range(self.num_envs)]
        listed = [None] * self.num_envs if seed is None else list(seed)
        if len(listed) != self.num_envs:
            raise error.Error(f"seed: {len(listed)} seeds: must be one number, or {self.num_envs}")
        if not self.lanes.begun:
            drawn = self.np_random.integers(2**63, size=self.num_envs).tolist()
            listed = [other if own is None else own for own, other in zip(listed, drawn, strict=True)]
            if not marked.all():
                raise error.ResetNeeded(f"the first reset begins all sub-environments: leave out options['{_MASK}']")
        return listed

    def _require_open(self) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError("the environment is closed: make another")


def _mask(options: dict[str, Any] | None, count: int) -> np.ndarray:
    if options is None or _MASK not in options:
        return np.ones(count, bool)
    mask = options[_MASK]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,) or not mask.any():
        raise error.Error(f"options['{_MASK}']: {mask!r}: must be a NumPy array of {count} bools, at least one True")
    return mask


def _remade(num_envs: int, mode: AutoresetMode, options: TaskOptions) -> SimyardVectorEnv:
    return SimyardVectorEnv(num_envs, autoreset_mode=mode, **options)
