"""Rollouts become data sets: the episodes that the seed says, complete, in the layouts that others read."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from gymnasium import error, spaces
from minari.storage.local import load_dataset

from simyard.gym import Rollout, SimyardVectorEnv, collect, export_minari


def made(steps: int, *, passed: bool = False) -> Rollout:
    """Returns an episode that nothing drove."""
    numbers = np.arange(steps + 1, dtype=np.float32)
    seen = {"ranges_m": np.stack([numbers, numbers + 1], axis=1), "time_s": numbers}
    actions = np.full((steps, 2), 0.5, np.float32)
    infos = {"world": "hand/one", "seed": 7, "passed": passed}
    return Rollout(seen, actions, np.ones(steps, np.float32), passed, not passed, infos)


@pytest.mark.long
def test_collected_episodes_are_whole_and_follow_from_the_seed(options: dict[str, Any]):
    env = SimyardVectorEnv(3, **options)
    rollouts = collect(env, lambda seen: np.full((len(seen["ranges_m"]), 2), 0.2, np.float32), 7, 11)
    again = collect(env, lambda seen: np.full((len(seen["ranges_m"]), 2), 0.2, np.float32), 7, 11)
    assert [each.infos for each in rollouts] == [each.infos for each in again]
    assert [len(each.actions) for each in rollouts] == [20] * 7
    assert [len(np.asarray(dict(each.observations)["ranges_m"])) for each in rollouts] == [21] * 7
    assert all(each.truncated and each.infos["reason"] == "timeout" for each in rollouts)


@pytest.mark.filterwarnings(
    "ignore::UserWarning:minari"
)  # it asks for an author, a link to the code, a registered environment
def test_a_minari_data_set_holds_the_episodes_as_they_were(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    spaces_of = SimpleNamespace(
        single_observation_space=spaces.Dict(
            {"ranges_m": spaces.Box(0, 99, (2,), np.float32), "time_s": spaces.Box(0, 99, (), np.float32)}
        ),
        single_action_space=spaces.Box(-1, 1, (2,), np.float32),
    )
    made_of = [made(4), made(3, passed=True)]
    export_minari(made_of, cast("SimyardVectorEnv", spaces_of), "simyard/hand/made-v0", policy="by hand")
    again = load_dataset("simyard/hand/made-v0")
    assert (again.total_episodes, again.total_steps) == (2, 7)
    for episode, rollout in zip(again.iterate_episodes(), made_of, strict=True):
        np.testing.assert_array_equal(episode.observations["ranges_m"], dict(rollout.observations)["ranges_m"])
        np.testing.assert_array_equal(episode.actions, rollout.actions)
        assert (episode.terminations[-1], episode.truncations[-1]) == (rollout.terminated, rollout.truncated)


def test_no_rollouts_are_no_data_set():
    with pytest.raises(error.Error, match="no rollouts"):
        export_minari([], cast("SimyardVectorEnv", None), "simyard/hand/none-v0")
