"""Drives of an audit: parts of a sample that are driven at a time, on threads of their own.

What runs an application's code stays on the thread that asks: its import, its tracing in the first slice, and
controllers on the host. The rest is compiled, and steps in C: on a thread of its own it drives beside the next part,
which is being loaded meanwhile. What a part does depends on no other.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from pathlib import Path
from types import TracebackType
from typing import Self

import jax
import numpy as np
from jaxtyping import Float32

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.audit.audit_findings import DrivenEpisode
from tasks.simulate.chunk.episodes import ReadyChunk, keep_timing, ready_parts
from tasks.simulate.chunk.run_rows import lane_row, open_run
from tasks.simulate.devices import device_count
from tasks.simulate.engine.program import Run
from tasks.simulate.host.host_lanes import most_lanes
from tasks.simulate.lane.lane_state import LaneState
from tasks.simulate.plan.chunks import plan_chunks

UNDISTURBED_M = (0.0, 0.0)
Poses = Float32[np.ndarray, "lanes steps 3"]


class Drives:
    """Drives episodes while others are made ready; a context that ends when all that was begun has ended.

    So many parts as there are cores are under way at a time, which bounds the memory that they take.
    """

    def __init__(self) -> None:
        """Begins with none."""
        self._most = device_count()
        self._threads = ThreadPoolExecutor(self._most, "simyard audit")
        self._under_way: set[Future[list[DrivenEpisode]]] = set()

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, where: TracebackType | None
    ) -> None:
        """Waits for what was begun."""
        self._threads.shutdown(cancel_futures=True)

    def begin(
        self,
        requests: Sequence[EpisodeRequest],
        worlds: Mapping[str, World],
        bundles: Mapping[str, Path],
        *,
        lanes: int,
        engine: str,
        beside_m: tuple[float, float] = UNDISTURBED_M,
    ) -> Callable[[], dict[int, DrivenEpisode]]:
        """Returns what waits until episodes are driven, and returns them, as ``audit_drive.drive_sample`` does.

        Raises:
            BundleCrash: An application does not import, or raises when it is traced.
        """
        lanes = min(lanes, most_lanes(requests, bundles) or lanes)
        parts = [
            self._begin_part(ready, ready.run)
            for chunk in plan_chunks(requests, lanes)
            for ready in ready_parts(chunk.requests, worlds, bundles, lanes=lanes, engine=engine, beside_m=beside_m)
            if ready.run is not None
        ]
        return lambda: {each.row.index: each for part in parts for each in part.result()}

    def _begin_part(self, chunk: ReadyChunk, run: Run) -> Future[list[DrivenEpisode]]:
        if run.host is not None:
            part: Future[list[DrivenEpisode]] = Future()
            with open_run(run):
                end, poses = _driven_on(chunk, run, *_first_slice(chunk, run))
            part.set_result(_driven(chunk, run, end, poses))
            return part
        first = _first_slice(chunk, run)
        while len(self._under_way) >= self._most:
            self._under_way -= wait(self._under_way, return_when=FIRST_COMPLETED).done
        part = self._threads.submit(copy_context().run, _drive_rest, chunk, run, *first)
        self._under_way.add(part)
        return part


def _first_slice(chunk: ReadyChunk, run: Run) -> tuple[LaneState, Poses]:
    state, record = run.advance(run.begin())
    poses = np.asarray(record.pose)
    chunk.watch.mark()
    return state, poses


def _drive_rest(chunk: ReadyChunk, run: Run, state: LaneState, first: Poses) -> list[DrivenEpisode]:
    return _driven(chunk, run, *_driven_on(chunk, run, state, first))


def _driven_on(chunk: ReadyChunk, run: Run, state: LaneState, first: Poses) -> tuple[LaneState, list[Poses]]:
    """Returns the lanes' last state on the host, and the poses of each slice."""
    poses = [first]
    while not np.all(state.done):
        state, record = run.advance(state)
        poses.append(np.asarray(record.pose))
        chunk.watch.mark()
    return _end(state), poses


def _end(state: LaneState) -> LaneState:
    """Returns the lanes' last state on the host, without the applications' own."""
    return jax.device_get(state._replace(controller=None, scenario=None))


def _driven(chunk: ReadyChunk, run: Run, end: LaneState, poses: list[Poses]) -> list[DrivenEpisode]:
    keep_timing(chunk)
    path = np.concatenate(poses, axis=1)
    return [
        DrivenEpisode(
            engine=chunk.program.engine,
            row=lane_row(chunk.program, run.host, lane, position, end, poses),
            places_m=path[position, : int(end.step[position]), :2],
        )
        for position, lane in enumerate(chunk.lanes)
    ]
