"""Episodes of an audit driven again, with the way that each robot took."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from specs.episode import EpisodeRequest, EpisodeResult
from specs.world import World
from tasks.simulate.chunks import plan_chunks
from tasks.simulate.episodes import keep_timing, ran_on, ready_chunk
from tasks.simulate.outcomes import finished_row


class Driven(NamedTuple):
    """An episode driven again: its row, and its place at the end of each control step."""

    engine: str
    row: EpisodeResult
    places_m: Float32[np.ndarray, "steps 2"]


def driven(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
) -> dict[int, Driven]:
    """Returns episodes driven to their ends, by index; without those that could not start.

    Args:
        requests: Any of a batch.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program.
        engine: ``auto``, or the engine that must drive them.

    Raises:
        BundleCrash: An application does not import, or raises when it is traced.
    """
    return {
        each.row.index: each
        for chunk in plan_chunks(requests, lanes)
        for each in _driven_chunk(chunk.requests, worlds, bundles, lanes=lanes, engine=engine)
    }


def _driven_chunk(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
) -> list[Driven]:
    chunk = ready_chunk(requests, worlds, bundles, lanes=lanes, engine=engine)
    if chunk.run is None:
        return []
    state, poses = chunk.run.begin(), list[Float32[np.ndarray, "lanes steps 3"]]()
    while not np.all(state.done):
        state, record = chunk.run.advance(state)
        poses.append(np.asarray(record.pose))
        chunk.watch.mark()
    keep_timing(chunk)
    end, path = jax.device_get(state._replace(controller=None, scenario=None)), np.concatenate(poses, axis=1)
    return [
        Driven(
            engine=chunk.program.engine,
            row=ran_on(chunk.program.engine, finished_row(lane, position, end, poses)),
            places_m=path[position, : int(end.step[position]), :2],
        )
        for position, lane in enumerate(chunk.lanes)
    ]
