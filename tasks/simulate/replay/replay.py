"""Replays an episode of a batch from nothing but the batch's record."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from specs.base import Fault
from specs.data.episode import EpisodeRequest
from specs.data.world import World
from specs.errors import ResourceNotFound
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.prepared_chunks import batch_mounts, load_worlds
from tasks.simulate.replay.driven_again import DrivenAgain
from tasks.simulate.replay.replay_apart import drive_apart


class Replay(NamedTuple):
    """An episode simulated once more.

    Attributes:
        request: What it was asked for.
        world: Where.
        driven: What came of it this time.
    """

    request: EpisodeRequest
    world: World
    driven: DrivenAgain


def replay(batch: OpenBatch, index: int, bundles: Mapping[str, Path], *, engine: str = "") -> Replay:
    """Returns an episode simulated once more: as its batch did it, with its lanes, world, seed and bundles.

    Args:
        batch: The batch.
        index: Which of its episodes.
        bundles: Unpacked folders of its applications, by digest.
        engine: What drove it, where that is known; else what the batch asked for.

    Raises:
        ResourceNotFound: Its world or its data are gone, or not what they were.
        SimulatorEnded: The process that simulates ended over it.
    """
    request = batch.layout.request(index)
    worlds, missing = load_worlds(batch, [request])
    mounted = batch_mounts(batch)
    if why := missing.get(request.world) or mounted.failure(request):
        fault = Fault(path="simulation-job", value=f"{batch.id}/{index}", allowed=f"one that can be replayed: {why}")
        raise ResourceNotFound([fault], source="simyard")
    driven = drive_apart(
        mounted.resolved(request),
        worlds,
        bundles,
        lanes=batch.plan.lanes,
        engine=engine or batch.plan.engine,
        rate_hz=batch.plan.recordings.rateHz,
    )
    return Replay(request, worlds[request.world], driven)
