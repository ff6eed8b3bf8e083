"""`SimyardVectorEnv`: hundreds of robots in as many episodes, a control step of all of them in one compiled call."""

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from simyard.gym.lanes import EnvironmentLanes, Info, Observation, lane_of, marked_infos
from simyard.gym.task_options import TaskOptions

_MASK = "reset_mask"


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
