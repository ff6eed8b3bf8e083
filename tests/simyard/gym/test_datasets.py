"""Rollouts become data sets: the episodes that the seed says, complete, in the layouts that others read."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from gymnasium import error

from simyard.gym import Rollout, SimyardVectorEnv, collect, export_lerobot


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


def test_a_lerobot_data_set_has_a_file_for_each_episode_and_says_what_they_hold(tmp_path: Path):
    root = export_lerobot([made(4), made(3, passed=True)], tmp_path / "set", task="Go to the goal.")
    info = json.loads((root / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"], info["fps"]) == ("v2.1", 2, 7, 20)
    table = pq.read_table(root / info["data_path"].format(episode_chunk=0, episode_index=1))
    assert set(table.column_names) == set(info["features"])
    columns = table.to_pydict()
    assert columns["index"] == [4, 5, 6]
    assert columns["timestamp"] == pytest.approx([0.0, 0.05, 0.1])
    assert columns["observation.ranges_m"] == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]
    assert columns["next.done"] == columns["next.success"] == [False, False, True]
    lines = [json.loads(line) for line in (root / "meta" / "episodes.jsonl").read_text().splitlines()]
    assert [line["length"] for line in lines] == [4, 3]
    statistics = json.loads((root / "meta" / "episodes_stats.jsonl").read_text().splitlines()[0])
    assert statistics["stats"]["action"]["mean"] == [0.5, 0.5]


def test_a_data_set_is_never_written_over_another(tmp_path: Path):
    with pytest.raises(error.Error, match="is there already"):
        export_lerobot([made(2)], tmp_path, task="Go.")
    with pytest.raises(error.Error, match="no rollouts"):
        export_lerobot([], tmp_path / "new", task="Go.")
