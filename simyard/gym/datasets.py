"""Episodes that a policy drives in a vector of environments, kept step by step, and written as a Minari data set."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode

from simyard.gym.vector_env import Observation, SimyardVectorEnv, lane_of

if TYPE_CHECKING:
    from minari import MinariDataset

PolicyFunction = Callable[[Any], np.ndarray]


class Rollout(NamedTuple):
    """An episode, its steps first.

    Attributes:
        observations: One more than there are steps: the first is before the first step.
        actions, rewards: Of each step.
        terminated, truncated: How it ended.
        infos: Its world and seed, and how it stood at its end.
    """

    observations: Observation
    actions: np.ndarray
    rewards: np.ndarray
    terminated: bool
    truncated: bool
    infos: dict[str, Any]


def collect(env: SimyardVectorEnv, policy: PolicyFunction, episodes: int, seed: int) -> list[Rollout]:
    """Returns episodes that a policy drives: the first of each robot, then the second of each, ...

    Which ones they are follows from the seed alone, not from which end first.

    Args:
        env: Whose autoreset is that of the next step.
        policy: Takes the observations of all robots, gives an action for each.
        episodes: How many.
        seed: As for ``reset``.
    """
    if env.metadata["autoreset_mode"] is not AutoresetMode.NEXT_STEP:
        raise error.Error("collect: the environment's autoreset_mode must be NextStep")
    each = -(-episodes // env.num_envs)
    observation, infos = env.reset(seed=seed)
    lanes = [_Lane(lane_of(observation, lane), _own(infos, lane)) for lane in range(env.num_envs)]
    while any(len(lane.ended) < each for lane in lanes):
        actions = policy(observation)
        observation, reward, terminated, truncated, infos = env.step(actions)
        for number, lane in enumerate(lanes):
            flags = bool(terminated[number]), bool(truncated[number])
            lane.add(lane_of(observation, number), actions[number], float(reward[number]), flags, _own(infos, number))
    ordered = [lane.ended[turn] for turn in range(each) for lane in lanes]
    return ordered[:episodes]


class _Lane:
    """One robot's episodes as they come."""

    def __init__(self, first: Observation, infos: dict[str, Any]) -> None:
        self.ended: list[Rollout] = []
        self._begin(first, infos)

    def add(
        self,
        observation: Observation,
        action: np.ndarray,
        reward: float,
        flags: tuple[bool, bool],
        infos: dict[str, Any],
    ) -> None:
        """Keeps a step, which only begins an episode where the last one has ended."""
        if self._over:
            self._begin(observation, infos)
            return
        self._seen.append(observation)
        self._actions.append(np.array(action))
        self._rewards.append(reward)
        self._over = any(flags)
        if self._over:
            rewards = np.asarray(self._rewards, np.float32)
            self.ended.append(
                Rollout(_stacked(self._seen), np.stack(self._actions), rewards, *flags, {**self._infos, **infos})
            )

    def _begin(self, first: Observation, infos: dict[str, Any]) -> None:
        self._seen: list[Observation] = [first]
        self._actions: list[np.ndarray] = []
        self._rewards: list[float] = []
        self._infos, self._over = infos, False


def _own(infos: dict[str, Any], lane: int) -> dict[str, Any]:
    found = {name: each[lane] for name, each in infos.items() if not name.startswith("_") and infos[f"_{name}"][lane]}
    return {name: each.item() if isinstance(each, np.generic) else each for name, each in found.items()}


def _stacked(seen: list[Observation]) -> Observation:
    if isinstance(seen[0], dict):
        return {name: np.stack([each[name] for each in seen if isinstance(each, dict)]) for name in seen[0]}
    return np.stack([each for each in seen if isinstance(each, np.ndarray)])


def export_minari(
    rollouts: Sequence[Rollout], env: SimyardVectorEnv, dataset: str, *, policy: str = "", description: str = ""
) -> "MinariDataset":
    """Writes rollouts as a Minari data set, where Minari keeps its own (``MINARI_DATASETS_PATH``), and returns it.

    Args:
        rollouts: At least one.
        env: That they were collected from.
        dataset: Its id, such as ``simyard/delivery/courier-v0``.
        policy: What drove, in words.
        description: Of the data set.

    Raises:
        Error: There are no rollouts.
    """
    import minari  # noqa: PLC0415 - whoever writes no Minari data set needs none
    from minari.data_collector import EpisodeBuffer  # noqa: PLC0415 - same

    if not rollouts:
        raise error.Error(f"{dataset}: no rollouts")
    buffers = [
        EpisodeBuffer(
            id=number,
            seed=rollout.infos.get("seed"),
            observations=rollout.observations,
            actions=rollout.actions,
            rewards=rollout.rewards.tolist(),
            terminations=_last(len(rollout.actions), flag=rollout.terminated),
            truncations=_last(len(rollout.actions), flag=rollout.truncated),
        )
        for number, rollout in enumerate(rollouts)
    ]
    return minari.create_dataset_from_buffers(
        dataset,
        buffers,
        observation_space=env.single_observation_space,
        action_space=env.single_action_space,
        algorithm_name=policy,
        description=description,
        data_format="arrow",
    )


def _last(steps: int, *, flag: bool) -> list[bool]:
    return [*np.zeros(steps - 1, bool).tolist(), flag]
