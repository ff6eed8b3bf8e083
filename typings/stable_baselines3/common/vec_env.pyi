from collections.abc import Iterable

import gymnasium

class VecEnv:
    num_envs: int
    def __init__(
        self, num_envs: int, observation_space: gymnasium.Space[object], action_space: gymnasium.Space[object]
    ) -> None: ...
    def _get_indices(self, indices: int | Iterable[int] | None) -> Iterable[int]: ...
