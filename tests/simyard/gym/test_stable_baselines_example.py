"""Stable-Baselines3's form of a vector, on a stand-in for its base class: the real one needs torch, a gigabyte."""

import importlib
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest


class VecEnv:
    """What Stable-Baselines3's base class does in its constructor, and nothing else."""

    def __init__(self, num_envs: int, observation_space: object, action_space: object) -> None:
        self.num_envs, self.observation_space, self.action_space = num_envs, observation_space, action_space
        self.render_mode = self.get_attr("render_mode")[0]

    def get_attr(self, attr_name: str) -> list[Any]:
        raise NotImplementedError

    def _get_indices(self, indices: object) -> object:
        return range(self.num_envs) if indices is None else [indices] if isinstance(indices, int) else indices


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    parent, common, module = (ModuleType(name) for name in ("stable_baselines3", "common", "vec_env"))
    module.__dict__["VecEnv"] = VecEnv
    monkeypatch.setitem(sys.modules, "stable_baselines3", parent)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common", common)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", module)
    monkeypatch.delitem(sys.modules, "examples.training.stable_baselines_vector", raising=False)
    yield importlib.import_module("examples.training.stable_baselines_vector").StableBaselinesVecEnv
    sys.modules.pop("examples.training.stable_baselines_vector", None)


def stepped(env: Any) -> tuple[Any, ...]:  # noqa: ANN401 - a class that is imported in the fixture
    env.step_async(np.zeros((3, 2), np.float32))
    return env.step_wait()


@pytest.mark.long
def test_an_episode_that_ends_is_followed_by_the_next_and_keeps_its_last_observation(
    options: dict[str, Any], adapter: Callable[..., Any]
):
    env = adapter(3, **options)
    env.seed(5)
    first = env.reset()
    answers = [stepped(env) for _ in range(20)]
    seen, rewards, done, infos = answers[-1]
    assert done.all()
    assert rewards.dtype == np.float32
    assert [info["TimeLimit.truncated"] for info in infos] == [True] * 3
    assert infos[0]["terminal_observation"].shape == first[0].shape
    assert not np.array_equal(infos[0]["terminal_observation"], seen[0])
    assert infos[0]["reason"] == "timeout"


def test_robots_share_their_attributes(options: dict[str, Any], adapter: Callable[..., Any]):
    env = adapter(3, **options)
    assert env.get_attr("num_envs", [0, 2]) == [3, 3]
    assert env.env_is_wrapped(object) == [False] * 3
    with pytest.raises(ValueError, match="robots share"):
        env.set_attr("colour", "red", [1])
