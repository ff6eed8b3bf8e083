"""Writes rollouts as a LeRobot data set, version 2.1: a Parquet file for each episode, and what they hold as JSON.

The layout is that of https://huggingface.co/docs/lerobot/lerobot-dataset-v3 in its form before version 3, which
LeRobot itself turns into version 3 (``lerobot.datasets.v30.convert_dataset_v21_to_v30``).
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from gymnasium import error

from simyard.gym.datasets import Rollout
from specs.data.episode import CONTROL_HZ

_VERSION = "v2.1"
_CHUNK = 1000
_DATA = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"


def export_lerobot(
    rollouts: Sequence[Rollout], folder: str | os.PathLike[str], *, task: str, robot: str = "simyard"
) -> Path:
    """Writes rollouts as a LeRobot data set, and returns its folder.

    An observation's fields become ``observation.<field>``, a flat one ``observation.state``.

    Args:
        rollouts: At least one.
        folder: A new one.
        task: What the robot does, in words.
        robot: Its name.

    Raises:
        Error: There are no rollouts, or the folder is there already.
    """
    root = Path(folder)
    if not rollouts or root.exists():
        raise error.Error(f"{root}: " + ("is there already: give a new folder" if rollouts else "no rollouts"))
    (root / "meta").mkdir(parents=True)
    begin, episodes, statistics = 0, list[str](), list[str]()
    for number, rollout in enumerate(rollouts):
        columns = _columns(rollout, number, begin)
        path = root / _DATA.format(episode_chunk=number // _CHUNK, episode_index=number)
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(_table(columns), path)
        length = len(rollout.actions)
        episodes.append(json.dumps({"episode_index": number, "tasks": [task], "length": length}))
        statistics.append(json.dumps({"episode_index": number, "stats": _statistics(columns)}))
        begin += length
    features = {name: _feature(each) for name, each in _columns(rollouts[0], 0, 0).items()}
    _write(root / "meta" / "info.json", [json.dumps(_info(len(rollouts), begin, features, robot), indent=2)])
    _write(root / "meta" / "tasks.jsonl", [json.dumps({"task_index": 0, "task": task})])
    _write(root / "meta" / "episodes.jsonl", episodes)
    _write(root / "meta" / "episodes_stats.jsonl", statistics)
    return root


def _columns(rollout: Rollout, number: int, begin: int) -> dict[str, np.ndarray]:
    """Returns an episode's columns, steps first; what is seen is what each step was decided on."""
    steps = len(rollout.actions)
    seen = rollout.observations if isinstance(rollout.observations, dict) else {"state": rollout.observations}
    frames = np.arange(steps, dtype=np.int64)
    done = frames == steps - 1
    return {
        **{f"observation.{name}": each[:steps].reshape(steps, -1) for name, each in seen.items()},
        "action": rollout.actions,
        "next.reward": rollout.rewards,
        "next.done": done,
        "next.success": done & bool(rollout.infos.get("passed", False)),
        "timestamp": (frames / CONTROL_HZ).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.full(steps, number, np.int64),
        "index": begin + frames,
        "task_index": np.zeros(steps, np.int64),
    }


def _table(columns: Mapping[str, np.ndarray]) -> pa.Table:
    arrays = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(each.ravel()), each.shape[1])
        if each.ndim > 1
        else pa.array(each)
        for name, each in columns.items()
    }
    return pa.table(arrays)


def _feature(column: np.ndarray) -> dict[str, Any]:
    return {"dtype": str(column.dtype), "shape": [column.shape[1] if column.ndim > 1 else 1], "names": None}


def _statistics(columns: Mapping[str, np.ndarray]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for name, each in columns.items():
        wide = each.reshape(len(each), -1).astype(np.float64)
        parts = {"min": wide.min(0), "max": wide.max(0), "mean": wide.mean(0), "std": wide.std(0)}
        found[name] = {part: value.tolist() for part, value in parts.items()} | {"count": [len(each)]}
    return found


def _info(episodes: int, frames: int, features: Mapping[str, Any], robot: str) -> dict[str, Any]:
    return {
        "codebase_version": _VERSION,
        "robot_type": robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": -(-episodes // _CHUNK),
        "chunks_size": _CHUNK,
        "fps": CONTROL_HZ,
        "splits": {"train": f"0:{episodes}"},
        "data_path": _DATA,
        "video_path": None,
        "features": features,
    }


def _write(path: Path, lines: Sequence[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
