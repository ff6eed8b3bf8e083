"""The episodes of a search, driven on this machine: by its own process, or by a worker that was given some of them."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.errors import StageFailed
from tasks.results.gate.missing_data import ROBOTS_OWN
from tasks.results.statistics.populations import FAILED
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkRunner
from tasks.simulate.plan.batch_plan import DEFAULT_LANES
from tasks.simulate.replay.replay_run import resimulate
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read

# Pilots and tails take a few episodes at a time, for which a program of all lanes takes several times as long. Whatever
# sizes steps have, there are three programs at most, and the batch has compiled one of them.
_FEW_LANES = 64

DriveEpisodes = Callable[[Sequence[EpisodeRequest], str], list[EpisodeResult]]
"""Returns what came of some episodes of a search on an engine, in their order."""


def is_canceled(store: Store, run: str) -> bool:
    """Returns whether somebody has cancelled the run that a search is a stage of; it may be of none."""
    return bool(run) and read(store, "pipeline-run", run).status in {"Canceling", "Canceled"}


def drive_episodes(
    batch: OpenBatch, requests: Sequence[EpisodeRequest], engine: str, folders: Mapping[str, Path]
) -> list[EpisodeResult]:
    """Returns what came of episodes like a batch's, with as many lanes as fit a program that there is.

    Args:
        batch: The batch.
        requests: The episodes; all run the same applications.
        engine: What drives them.
        folders: Unpacked folders of the applications alone, by digest.
    """
    plan = batch.plan
    runner = ChunkRunner(folders, engine, plan.recordings.rateHz, lambda _: None)
    return resimulate(batch, requests, runner.run, _lanes(plan.lanes, len(requests)))


def shared_out(batch: OpenBatch, requests: Sequence[EpisodeRequest], workers: int) -> list[tuple[EpisodeRequest, ...]]:
    """Returns a step's episodes in pieces: one for each worker, but none larger than all lanes, or smaller than few.

    Args:
        batch: The batch.
        requests: The step's episodes.
        workers: How many there are.
    """
    size = min(max(math.ceil(len(requests) / workers), _FEW_LANES), max(batch.plan.lanes, DEFAULT_LANES))
    return [tuple(requests[first : first + size]) for first in range(0, len(requests), size)]


def _lanes(batch: int, episodes: int) -> int:
    """Returns how many lanes a step's program has: the fewest that hold it, of those of the batch, a few, and all."""
    most = max(batch, DEFAULT_LANES)
    return min((each for each in (batch, _FEW_LANES) if each >= episodes), default=most)


def score_of(row: EpisodeResult, measure: str) -> float | None:
    """Returns how far an episode was from failing: its measure, or that it failed.

    Raises:
        StageFailed: It is not the robot that did not end it.
    """
    passed = success(row)
    if passed is None or (row.status == "Failed" and row.failure_code not in ROBOTS_OWN):
        raise StageFailed(row.failure_code or "Canceled", f"an episode of the search: {row.failure_reason}")
    value = getattr(row, measure)
    if not passed or (value is not None and value < 0.0):
        return FAILED
    return None if value is None or math.isnan(value) else float(value)


def why_failed(row: EpisodeResult, measure: str) -> str:
    """Returns why an episode failed, in a word or two; empty if it did not."""
    return reason(row) or (measure if score_of(row, measure) == FAILED else "")
