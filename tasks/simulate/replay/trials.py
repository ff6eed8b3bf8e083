"""Simulates one episode in other worlds and with other seeds, all together."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.prepared_chunks import batch_mounts
from tasks.simulate.host.host_lanes import most_lanes
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.process.lanes import ConfinedLanes
from tasks.simulate.replay.failure_likeness import Ending

# Of an episode, how it begins and ends is all that is looked at.
_ENDS_ALONE_HZ = 1e-6


class Trial(NamedTuple):
    """A world and a seed to try an episode with."""

    world: World
    seed: int


def simulate_trials(
    batch: OpenBatch, request: EpisodeRequest, trials: Sequence[Trial], bundles: Mapping[str, Path], *, engine: str = ""
) -> list[Ending]:
    """Returns how an episode ends in other worlds or with other seeds, in the order of the trials.

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
    most = min(batch.plan.lanes, most_lanes(requests, bundles) or batch.plan.lanes)
    endings: list[Ending] = []
    for chunk in plan_chunks(requests, most):
        recorder = Recorder(_ENDS_ALONE_HZ, lambda _: True)
        lanes = ConfinedLanes(
            bundles=bundles,
            lanes=batch.plan.lanes,
            engine=engine or batch.plan.engine,
            should_stop=lambda: False,
            rate_hz=_ENDS_ALONE_HZ,
            recorder=recorder,
        )
        endings += _endings(chunk, worlds, lanes, recorder)
    return endings


def _endings(chunk: Chunk, worlds: Mapping[str, World], lanes: ConfinedLanes, recorder: Recorder) -> list[Ending]:
    rows = lanes.simulate(chunk, worlds)
    goals = {
        int(index): (float(x_m), float(y_m))
        for part in recorder.parts()
        for index, (x_m, y_m) in zip(part["index"], part["goal_m"], strict=True)  # of an episode the last one stays
    }
    return [Ending(row, goals.get(row.index)) for row in rows]
