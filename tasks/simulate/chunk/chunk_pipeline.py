"""The pipeline of a batch's chunks: the one that was asked for, and those to be asked for next, in the same lanes.

While lanes drive, the next chunk's episodes are placed, and rows of episodes that ended are made. An episode of the
next chunk begins as soon as a lane is free. Each chunk is answered as a whole, with the bits that it has alone
(docs/decisions/0038-lanes-that-are-refilled.md).
"""

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TypeGuard

import numpy as np

from specs.data.episode import CONTROL_S
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.application.bundle_code import timed_call
from tasks.simulate.chunk.byproducts import TurnWatch, note_timing
from tasks.simulate.chunk.chunk_placement import (
    PlacedChunk,
    check_applications,
    lane_forms,
    part_program,
    placing,
    program_of,
)
from tasks.simulate.chunk.lane_pool import EpisodeGroup, LanePool, LaneSetting, PendingChunk
from tasks.simulate.devices import running_s
from tasks.simulate.engines.compiled_program import CompiledProgram
from tasks.simulate.engines.program import Program
from tasks.simulate.lane.recording import SampleRecorder, sample_stride
from tasks.simulate.lane.result_rows import stopped_row
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk

logger = logging.getLogger(__name__)
# Of samples, until their chunk is asked for: more are sent slice by slice, and a run keeps them in a file.
_KEPT_BYTES = 256 << 20
_Key = tuple[object, ...]


class ChunkPipeline:
    """Simulates chunk after chunk of a batch, each as soon as lanes are free."""

    def __init__(self) -> None:
        """Begins without chunks."""
        self._setting: LaneSetting | None = None
        self._refused: LaneSetting | None = None
        self._forget()

    def forget(self) -> None:
        """Leaves all chunks that are under way."""
        self._setting = None
        self._forget()

    def simulated(
        self,
        chunk: Chunk,
        ahead: Sequence[Chunk],
        worlds: Mapping[str, World],
        setting: LaneSetting,
        *,
        should_stop: Callable[[], bool],
        progress: Callable[[int], None],
        recorder: SampleRecorder | None,
    ) -> EpisodeColumns | None:
        """Returns a chunk's rows in request order; None if it has to be simulated by itself.

        Args:
            chunk: At most as many episodes as lanes.
            ahead: Chunks that are going to be asked for after it, in their order, as far as is known.
            worlds: By name, at least those of all these chunks.
            setting: What the chunks share.
            should_stop: Asked after each slice; episodes not done by then are Canceled.
            progress: Told as often how many of the chunk's episodes are done.
            recorder: Given what the lanes do.
        """
        if (
            chunk.requests[0].robots
            or setting == self._refused
            or any(request.world not in worlds for request in chunk.requests)
        ):
            self.forget()
            return None
        try:
            if not _is_refillable(program_of(chunk.requests[0], setting.bundles, setting.lanes, setting.engine)):
                self.forget()
                return None
            self._expect([chunk, *ahead], worlds, setting)
            return self._rows_of_first(should_stop, progress, recorder)
        except (Exception, SystemExit) as exc:  # noqa: BLE001 - who is to blame is found when it is simulated by itself
            self._leave(exc)
            return None

    def work_ahead(self) -> bool:
        """Drives a slice of what is going to be asked for; returns False if nothing is known of that."""
        if not self._pending:
            return False
        try:
            return self._turn()
        except (Exception, SystemExit) as exc:  # noqa: BLE001 - as above
            self._leave(exc)
            return False

    def _leave(self, exc: BaseException) -> None:
        """Leaves all chunks that are under way because of an exception; where memory was too little, for good."""
        logger.debug("simulated chunk by chunk", exc_info=exc)
        if isinstance(exc, MemoryError) or "RESOURCE_EXHAUSTED" in str(exc):
            self._refused = self._setting
        self.forget()

    def _forget(self) -> None:
        self._pending = deque[PendingChunk]()
        self._pools: dict[_Key, LanePool] = {}
        self._rows_to_make = deque[EpisodeGroup]()
        self._watch = TurnWatch()

    def _expect(self, chunks: Sequence[Chunk], worlds: Mapping[str, World], setting: LaneSetting) -> None:
        """Lets chunks come next, in this order; what else is under way is left."""
        known = [pending.chunk for pending in self._pending]
        if setting != self._setting or known != list(chunks[: len(known)]):
            self._forget()
            self._setting, known = setting, []
        for chunk in chunks[len(known) :]:
            if any(request.world not in worlds for request in chunk.requests):
                return
            steps = placing(chunk.requests, worlds, setting.bundles, lanes=setting.lanes, engine=setting.engine)
            self._pending.append(PendingChunk(chunk, steps))

    def _rows_of_first(
        self,
        should_stop: Callable[[], bool],
        progress: Callable[[int], None],
        recorder: SampleRecorder | None,
    ) -> EpisodeColumns:
        pending = self._pending[0]
        while not pending.placed:
            self._place_some()
        while (ended := pending.ended) < len(pending.chunk.requests):
            if should_stop():
                rows = self._answer(pending, recorder)
                self.forget()
                return rows
            self._turn()
            if pending.ended > ended:
                progress(pending.ended)
        self._pending.popleft()
        self._begin_next(at_once=True)
        rows = self._answer(pending, recorder)
        self._keep_timing(pending)
        # A chunk whose ways are not known yet holds lanes that nothing of it waits for.
        held = {id(pool) for each in self._pending for _, pool in each.parts}
        self._pools = {key: each for key, each in self._pools.items() if each.left or id(each) in held}
        return rows

    def _answer(self, pending: PendingChunk, recorder: SampleRecorder | None) -> EpisodeColumns:
        found = [EpisodeColumns.of(pending.failed)]
        for part, _ in pending.parts:
            found.append(part.all_rows())
            if recorder is not None:
                part.tell(recorder, found[-1])
        known, requests = EpisodeColumns.join(found), pending.chunk.requests
        if len(known) < len(requests):  # a chunk that was stopped before it was placed
            there = set(known.index.tolist())
            stopped = [stopped_row(request) for request in requests if request.index not in there]
            known = EpisodeColumns.join([known, EpisodeColumns.of(stopped)])
        return known.at(np.array([request.index for request in requests], np.int64))

    def _turn(self) -> bool:
        """Drives a slice of the lanes that hold the first chunk that is not done; does other work meanwhile."""
        if not self._pending[0].placed:
            return self._place_some()
        began_s = running_s()
        pool = self._begin_next()
        if pool is None:
            return self._place_some()
        while pool.computing and self._work_beside():
            pass
        with timed_call("slice", "", f"a slice of {SLICE_STEPS} control steps"):
            self._rows_to_make.extend(dict.fromkeys(each.part for each in pool.collect()))
        self._watch.drove(running_s() - began_s)
        self._require_room()
        return True

    def _require_room(self) -> None:
        """Leaves chunks whose samples are too many to be kept until they are asked for."""
        parts = [part for pending in self._pending for part, _ in pending.parts]
        if (kept := sum(part.kept_bytes for part in parts)) > _KEPT_BYTES:
            raise MemoryError(f"{kept} bytes of samples: at most {_KEPT_BYTES} are kept")

    def _begin_next(self, *, at_once: bool = False) -> LanePool | None:
        """Begins a slice of the lanes that hold the first chunk that is not done; returns them.

        A slice that is on its way stays the one. At once, only lanes begin that others have driven in: to compile a
        program, or to place a chunk, would keep rows waiting that are done.
        """
        pool = self._next_pool()
        if pool is None or pool.begun or (at_once and not pool.filled):
            return pool
        while not at_once and 2 * pool.left < pool.program.lanes and self._place_some():
            pass  # lanes that rest cost as much as others
        with timed_call("compile", "", "the first control step, which is compiled before"):
            pool.fill()
            pool.dispatch()
        pool.prepare()
        return pool

    def _next_pool(self) -> LanePool | None:
        begun = (pool for pool in self._pools.values() if pool.begun)
        parts = (part for pending in self._pending if pending.placed for part in pending.parts)
        return next(begun, None) or next((pool for part, pool in parts if part.ended < len(part.lanes)), None)

    def _work_beside(self) -> bool:
        """Does a piece of work that needs no lanes; returns False if there is none."""
        pending = next((each for each in self._pending if each.placed and not each.measured), None)
        if pending is not None:
            pending.measure_some()
            return True
        while self._rows_to_make:
            part = self._rows_to_make.popleft()
            if part.waiting:
                part.make_rows()
                return True
        return self._place_some(beside=True)

    def _place_some(self, *, beside: bool = False) -> bool:
        """Does a piece of placing the first chunk that is not placed; returns False if all are."""
        pending = next((each for each in self._pending if not each.placed), None)
        if pending is None:
            return False
        began_s = running_s()
        try:
            self._step(pending)
        except (Exception, SystemExit):
            if pending is self._pending[0]:
                raise
            logger.debug("chunk %d: not begun ahead", pending.chunk.number, exc_info=True)
            while self._pending[-1] is not pending:
                self._pending.pop()
            self._pending.pop()
            return False
        if not beside:
            self._watch.placed(running_s() - began_s)
        return True

    def _step(self, pending: PendingChunk) -> None:
        """Does a piece of placing a chunk, or of measuring its ways: then its longest episodes begin first.

        Where there are free lanes for all its episodes, they begin at once, and their ways are measured beside.
        """
        if pending.steps is None:
            pending.measure_some()
        else:
            try:
                next(pending.steps)
            except StopIteration as end:
                self._take(pending, end.value)
            else:
                return
        if pending.measured or pending.fits_into_free_lanes:
            pending.wait_for_lanes()

    def _take(self, pending: PendingChunk, found: PlacedChunk) -> None:
        for lanes in found.parts:
            check_applications(found.program, lanes[0])
        pending.steps, pending.failed = None, found.rows
        pending.parts = [self._part_of(found, lanes) for lanes in found.parts]

    def _part_of(self, found: PlacedChunk, lanes: list[Lane]) -> tuple[EpisodeGroup, LanePool]:
        setting = self._setting
        if setting is None:
            raise RuntimeError("no chunk was asked for")
        key = (found.program, *lane_forms(lanes[0]))
        if key not in self._pools:
            program = part_program(found, lanes, setting.bundles, lanes=setting.lanes, engine=setting.engine)
            if not _is_refillable(program):
                raise TypeError(f"{program.engine} fills no lanes")
            stride = None if setting.rate_hz is None else sample_stride(setting.rate_hz, CONTROL_S)
            self._pools[key] = LanePool(program, stride)
        pool = self._pools[key]
        return EpisodeGroup(pool.program, lanes), pool

    def _keep_timing(self, pending: PendingChunk) -> None:
        """Notes what went by since the chunk before."""
        watch, self._watch = self._watch, TurnWatch()
        if pending.parts:
            note_timing(watch.timing(max(pool.program.lanes for _, pool in pending.parts)))


def _is_refillable(program: Program) -> TypeGuard[CompiledProgram]:
    return isinstance(program, CompiledProgram) and program.host is None
