"""One robot in one episode after the other, as Gymnasium has it."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from simyard.gym import SimyardEnv


@pytest.fixture(scope="module")
def env(options: dict[str, Any]) -> SimyardEnv:
    return SimyardEnv(**options)


def test_gymnasiums_own_check_passes_without_a_warning(options: dict[str, Any]):
    check_env(gymnasium.make("simyard/Delivery-v0", **options).unwrapped)


def test_a_flat_observation_has_the_fields_in_the_order_that_was_asked_for(options: dict[str, Any], env: SimyardEnv):
    flat = SimyardEnv(**options, flatten=True, observation=("ranges_m", "goal_robot_m"))
    seen, _ = flat.reset(seed=3)
    parts, _ = env.reset(seed=3)
    assert np.array_equal(seen, np.concatenate([parts["ranges_m"], parts["goal_robot_m"]]))


def test_a_seed_decides_its_episodes_and_another_seed_has_others(env: SimyardEnv):
    def episodes(seed: int) -> list[tuple[str, int]]:
        infos = [env.reset(seed=seed)[1], *(env.reset()[1] for _ in range(5))]
        return [(info["world"], info["seed"]) for info in infos]

    assert episodes(1) == episodes(1)
    assert episodes(1) != episodes(2)
    assert len(set(episodes(1))) > 1


def test_an_episode_that_runs_out_of_time_is_truncated_and_says_how_it_stands(env: SimyardEnv):
    env.reset(seed=0)
    for _ in range(19):
        _, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        assert (terminated, truncated, info) == (False, False, {})
    _, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
    assert (terminated, truncated) == (False, True)
    assert (info["passed"], info["reason"], info["simulated_s"]) == (False, "timeout", 1.0)


def test_the_registered_name_makes_it(options: dict[str, Any]):
    made = gymnasium.make("simyard/Delivery-v0", **options)
    assert isinstance(made.unwrapped, SimyardEnv)
    assert made.reset(seed=1)[0].keys() == {"ranges_m", "goal_robot_m"}


def test_a_closed_environment_says_so_and_closes_twice(options: dict[str, Any]):
    env = SimyardEnv(**options)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.reset()
