"""`SimyardEnv`: one robot in one episode after the other, for checks and for trainers that know no vectors.

`gymnasium.make_vec("simyard/Delivery-v0")` finds both environments, as they are registered here.
"""

from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import error

from simyard.gym.task_options import TaskOptions
from simyard.gym.vector_env import EnvironmentLanes, Info, lane_info, lane_of

_ONE = np.ones(1, bool)
_SCENARIOS = {"simyard/Delivery-v0": "delivery", "simyard/Coverage-v0": "coverage"}


class SimyardEnv(gymnasium.Env[Any, np.ndarray]):
    """One lane of a `SimyardVectorEnv`: the same episodes for the same seed, bit for bit, and far slower.

    `reset(seed=s)` begins the first episode of a seed, `reset()` the next one.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, **options: Unpack[TaskOptions]) -> None:
        """Makes it.

        Args:
            options: See ``TaskOptions``.

        Raises:
            DocumentError: An option is wrong, or names what there is not.
        """
        self._options = options
        self._lanes = EnvironmentLanes(1, options, autoreset=False)
        self.observation_space, self.action_space = self._lanes.observation_space, self._lanes.action_space
        self._closed = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Info]:
        """Begins an episode.

        Args:
            seed: Begins the first episode of a seed; None for the next one.
            options: None is known.
        """
        self._require_open()
        super().reset(seed=seed, options=options)
        if seed is None and not self._lanes.begun:
            seed = int(self.np_random.integers(2**63))
        observation = self._lanes.reset(_ONE, [seed])
        return lane_of(observation, 0), lane_info(self._lanes.beginnings(), 0)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, Info]:
        """Drives the robot a control step of 50 ms.

        Args:
            action: As the action space says; beyond it, it is clipped.

        Raises:
            InvalidAction: It has another shape, or is no finite number.
        """
        self._require_open()
        done = self._lanes.step(np.asarray(action)[None])
        terminated, truncated = bool(done.terminated[0]), bool(done.truncated[0])
        info = lane_info(self._lanes.endings(), 0) if terminated or truncated else {}
        return lane_of(done.observation, 0), float(done.reward[0]), terminated, truncated, info

    def close(self) -> None:
        """Ends it; a second call does nothing."""
        self._closed = True

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns what makes it anew, before its first reset."""
        return _remade, (dict(self._options),)

    def _require_open(self) -> None:
        if self._closed:
            raise error.ClosedEnvironmentError("the environment is closed: make another")


def _remade(options: TaskOptions) -> SimyardEnv:
    return SimyardEnv(**options)


def register_environments() -> None:
    """Registers an environment for each shipped scenario; a second call does nothing."""
    for name, scenario in _SCENARIOS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="simyard.gym.single_env:SimyardEnv",
                vector_entry_point="simyard.gym.vector_env:SimyardVectorEnv",
                kwargs={"scenario": scenario},
                disable_env_checker=True,
            )
