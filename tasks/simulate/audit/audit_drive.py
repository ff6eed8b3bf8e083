"""The parity audit: drives a sample of a batch's episodes again, on their engine and on C MuJoCo, and compares.

C MuJoCo steps them in double precision among all solids. The engine that made the rows drives the sample again too:
that gives the ways to compare, and shows whether the rows are what it makes of their requests. Where they differ,
C MuJoCo drives the sample again from a micrometre beside: what it flips by itself is chaos, and no engine's error. Rows
that C MuJoCo made are made again and compared with nothing: that an engine agrees with itself says only that the rows
are its own.

Parts of the sample are driven at a time, on threads of their own. What runs an application's code stays on the thread
that asks: its import, its tracing in the first slice, and controllers on the host. The rest is compiled, and steps in
C: on a thread of its own it drives beside the next part, which is being loaded meanwhile. What a part does depends on
no other.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit.audit_report import AuditDrives, DrivenEpisode
from tasks.simulate.chunk.byproducts import note_timing
from tasks.simulate.chunk.chunk_simulation import LaneDrive, ReadyChunk, ready_parts
from tasks.simulate.chunk.lane_pool import lane_row, open_run
from tasks.simulate.devices import device_count
from tasks.simulate.engines.engine_table import REFERENCE
from tasks.simulate.engines.program import Run
from tasks.simulate.host.controllers import drawn_by
from tasks.simulate.host.declaration import most_lanes
from tasks.simulate.plan.chunks import plan_chunks

UNDISTURBED_M = (0.0, 0.0)


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
                drive = _to_end(LaneDrive(chunk, run))
            part.set_result(_driven_episodes(drive, run))
            return part
        drive = LaneDrive(chunk, run)
        drive.advance()
        while len(self._under_way) >= self._most:
            self._under_way -= wait(self._under_way, return_when=FIRST_COMPLETED).done
        part = self._threads.submit(copy_context().run, lambda: _driven_episodes(_to_end(drive), run))
        self._under_way.add(part)
        return part


def _to_end(drive: LaneDrive) -> LaneDrive:
    while not drive.done:
        drive.advance()
    return drive


def _driven_episodes(drive: LaneDrive, run: Run) -> list[DrivenEpisode]:
    chunk, end, path = drive.chunk, drive.end(), np.concatenate(drive.poses, axis=1)
    note_timing(chunk.watch.timing(chunk.program.lanes, drawn_by(run.host)))
    return [
        DrivenEpisode(
            engine=chunk.program.engine,
            row=lane_row(chunk.program, run.host, lane, position, end, drive.poses),
            places_m=path[position, : int(end.step[position]), :2],
        )
        for position, lane in enumerate(chunk.lanes)
    ]


logger = logging.getLogger(__name__)
DISTURBANCES_M = ((1e-6, 0.0), (0.0, 1e-6))
"""Where the control starts, from where the episode does (x, y): far below what any map or sensor knows."""


def drive_sample(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    beside_m: tuple[float, float] = UNDISTURBED_M,
) -> dict[int, DrivenEpisode]:
    """Returns episodes driven to their ends, by index; without those that could not start.

    Args:
        requests: Any of a batch.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program.
        engine: ``auto``, or the engine that must drive them.
        beside_m: How far from its place each robot starts (x, y).

    Raises:
        BundleCrash: An application does not import, or raises when it is traced.
    """
    with Drives() as drives:
        return drives.begin(requests, worlds, bundles, lanes=lanes, engine=engine, beside_m=beside_m)()


def drive_audit(
    here: Sequence[EpisodeRequest],
    others: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    progress: Callable[[int], None] = lambda _: None,
) -> AuditDrives:
    """Returns what driving episodes again shows, by their engine and by C MuJoCo.

    Args:
        here: Those that their engine drives.
        others: Those that C MuJoCo drives, in a program with no more lanes than there are episodes.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: Of a program. With those of the batch, the engine drives the sample in the batch's own programs, which
            are there already, or in one of a quarter of the lanes, which whoever recounts the batch takes, too.
        engine: What the batch asked for.
        progress: Told how many of both drives are done, or will not be made.

    Raises:
        BundleCrash: An application that made rows before now fails.
    """
    theirs, why = dict[int, DrivenEpisode](), ""
    with Drives() as drives:
        began_theirs: Callable[[], dict[int, DrivenEpisode]] | None = None
        if others:  # first, because it takes longer
            few = min(lanes, len({each.index for each in (*here, *others)}))
            try:
                began_theirs = drives.begin(others, worlds, bundles, lanes=few, engine=REFERENCE)
            except BundleCrash as crash:
                why = crash.reason
        ours = drives.begin(here, worlds, bundles, lanes=lanes, engine=engine)()
        progress(len(here))
        if began_theirs:
            theirs = began_theirs()
    progress(len(here) + len(others))
    return AuditDrives(ours, theirs, why)


def drive_control(
    requests: Sequence[EpisodeRequest], worlds: Mapping[str, World], bundles: Mapping[str, Path], *, lanes: int
) -> list[dict[int, DrivenEpisode]]:
    """Returns what C MuJoCo makes of episodes from a micrometre beside, in each direction; nothing if it cannot.

    All lanes are driven, and not only those that flipped: of these alone one could not tell a flip that is rare
    everywhere from one that is the engine's.
    """
    few = min(lanes, len(requests))
    try:
        return [
            drive_sample(requests, worlds, bundles, lanes=few, engine=REFERENCE, beside_m=beside_m)
            for beside_m in DISTURBANCES_M
        ]
    except BundleCrash as crash:
        logger.warning("the audit has no control: %s", crash.reason)
        return []
