"""Writes rollouts as a Minari data set, through Minari itself: `pip install minari`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from gymnasium import error

from simyard.gym.rollouts import Rollout
from simyard.gym.vector_env import SimyardVectorEnv

if TYPE_CHECKING:
    from minari import MinariDataset


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
