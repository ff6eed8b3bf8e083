"""`StableBaselinesVecEnv`: a `SimyardVectorEnv` in the form that Stable-Baselines3 trains on. To be copied."""

from collections.abc import Iterable, Sequence
from typing import Any, Unpack

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from simyard.gym.task_options import TaskOptions
from simyard.gym.vector_env import SimyardVectorEnv

Indices = int | Iterable[int] | None


class StableBaselinesVecEnv(VecEnv):
    """Robots in worlds of Simyard, for `stable_baselines3.PPO` and its like.

    An episode that ends is followed by the next one in the same step, as Stable-Baselines3 has it; what was seen last
    is `infos[i]["terminal_observation"]`.
    """

    def __init__(self, num_envs: int, **options: Unpack[TaskOptions]) -> None:
        """Makes it.

        Args:
            num_envs: How many robots.
            options: See ``TaskOptions``; observations are flat unless ``flatten`` says otherwise.

        Raises:
            DocumentError: An option is wrong, or names what there is not.
        """
        options.setdefault("flatten", True)
        self.envs = SimyardVectorEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        self._actions: np.ndarray | None = None
        self._seed: int | None = None
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """Begins episodes, the first of the seeds that were set."""
        observation, _ = self.envs.reset(seed=self._seed)
        self._seed = None
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Sets the seed of the next reset: s for the first robot, s + 1 for the second."""
        self._seed = int(np.random.default_rng().integers(2**31)) if seed is None else seed
        return [self._seed + lane for lane in range(self.num_envs)]

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions for ``step_wait``."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Drives all robots a control step of 50 ms."""
        assert self._actions is not None, "step_wait before step_async"  # noqa: S101 - a caller's order of calls
        observation, reward, terminated, truncated, vector = self.envs.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for lane in np.flatnonzero(done).tolist():
            final = {name: each[lane] for name, each in vector["final_info"].items() if not name.startswith("_")}
            infos[lane] = final | {
                "terminal_observation": vector["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane] and not terminated[lane]),
            }
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Ends it; a second call does nothing."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Returns an attribute, the same for each robot."""
        return [getattr(self.envs, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: object, indices: Indices = None) -> None:
        """Sets an attribute of all robots."""
        if len(self._chosen(indices)) != self.num_envs:
            raise ValueError(f"{attr_name}: robots share their attributes: leave out indices")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: object, indices: Indices = None, **kwargs: object) -> list[Any]:
        """Returns what a method of the vector returns, the same for each robot."""
        return [getattr(self.envs, method_name)(*args, **kwargs)] * len(self._chosen(indices))

    def env_is_wrapped(self, wrapper_class: type, indices: Indices = None) -> list[bool]:
        """Returns that no robot has a wrapper of its own."""
        return [False for _ in self._chosen(indices) if wrapper_class]

    def _chosen(self, indices: Indices) -> list[int]:
        return list(self._get_indices(indices))
