"""Simulates one episode in other worlds and with other seeds, all together."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.batch.commit import batch_mounts
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.host.host_lanes import most_lanes
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.process.lanes import ConfinedLanes


class Trial(NamedTuple):
    """A world and a seed to try an episode with."""

    world: World
    seed: int


def simulate_trials(
    batch: OpenBatch, request: EpisodeRequest, trials: Sequence[Trial], bundles: Mapping[str, Path], *, engine: str = ""
) -> list[EpisodeResult]:
    """Returns what becomes of an episode in other worlds or with other seeds, in the order of the trials.

    Args:
        batch: The episode's; its lanes are those of its program.
        request: The episode.
        trials: Simulated together, as many at a time as the batch has lanes, and as this machine holds.
        bundles: Unpacked folders of the batch's applications, by digest.
        engine: What drove it, where that is known; else what the batch asked for.

    Raises:
        MemoryError: There is not enough memory for so many lanes.
    """
    asked = batch_mounts(batch).resolved(request)
    worlds = {f"trials/{number}": trial.world for number, trial in enumerate(trials)}
    requests = [
        asked.model_copy(update={"index": number, "world": world, "seed": trials[number].seed})
        for number, world in enumerate(worlds)
    ]
    lanes = ConfinedLanes(
        bundles=bundles, lanes=batch.plan.lanes, engine=engine or batch.plan.engine, should_stop=lambda: False
    )
    most = min(batch.plan.lanes, most_lanes(requests, bundles) or batch.plan.lanes)
    return [row for chunk in plan_chunks(requests, most) for row in lanes.simulate(chunk, worlds)]
