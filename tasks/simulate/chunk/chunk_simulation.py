"""Simulates a chunk: places its episodes, runs the program slice by slice, makes rows.

Episodes whose arrays have other shapes are parts of the chunk that run one after the other.
"""

import contextlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float32

from specs.data.episode import CONTROL_S, ApplicationLaunch, EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash, CallKind, CrashCode, crash_of, timed_call
from tasks.simulate.chunk.byproducts import ChunkWatch, note_timing
from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline, LaneSetting
from tasks.simulate.chunk.chunk_placement import check_applications, part_program, place_chunk
from tasks.simulate.chunk.lane_pool import lane_ends, lane_row, open_run
from tasks.simulate.engines.program import Program, Run
from tasks.simulate.host.controllers import drawn_by
from tasks.simulate.lane.control_step import LaneState, StepRecord
from tasks.simulate.lane.recording import LaneRecorder, SampleRecorder
from tasks.simulate.lane.result_rows import stopped_row
from tasks.simulate.lane.staging import Lane, moved_lane, stack_lanes
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk

Poses = Float32[np.ndarray, "lanes steps 3"]


class ReadyChunk(NamedTuple):
    """Episodes of one program whose arrays have the same shapes, ready to run.

    Attributes:
        lanes: The episodes that can run, in the lanes' order.
        run: None when no episode can run.
        rows: Of the episodes that cannot; where there are several parts, with the first.
        watch: Takes the times.
    """

    program: Program
    lanes: list[Lane]
    run: Run | None
    rows: list[EpisodeResult]
    watch: ChunkWatch


def simulate_episodes(
    chunk: Chunk,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    should_stop: Callable[[], bool],
    progress: Callable[[int], None] = lambda _: None,
    recorder: SampleRecorder | None = None,
    pipeline: ChunkPipeline | None = None,
    ahead: Sequence[Chunk] = (),
) -> EpisodeColumns:
    """Returns the results of a chunk's episodes as columns, in request order.

    Whatever goes wrong inside an episode is its row: applications that do not import, raise or return what is not
    finite; worlds that are missing; states that blow up. The other rows are the same bits without it.

    Args:
        chunk: At most ``lanes`` episodes that share a program.
        worlds: By ``<generation>/<world>``; more than the chunk needs are ignored.
        bundles: Unpacked folders of the chunk's applications, by digest.
        lanes: How many lanes every chunk of the batch is padded to.
        engine: ``auto``, or the engine that must run them (``tasks.simulate.engines.engine_table``).
        should_stop: Asked every 1.25 simulated seconds; episodes not done by then are Canceled.
        progress: Told as often how many of the chunk's episodes are done.
        recorder: Given what the lanes do.
        pipeline: What of this chunk, and of those that follow, is simulated already; None to simulate it by itself.
        ahead: Chunks that are going to be asked for after it, in their order; ``worlds`` has theirs, too.
    """
    if pipeline is not None:
        setting = LaneSetting(bundles, lanes, engine, recorder.rate_hz if recorder else None)
        found = pipeline.simulated(
            chunk,
            ahead,
            worlds,
            setting,
            should_stop=should_stop,
            progress=progress,
            recorder=recorder,
        )
        if found is not None:
            return found
    missing = [request for request in chunk.requests if request.world not in worlds]
    rows = {
        each.index: failed_result(each.index, Failure("InvalidS3Resource", f"world {each.world} does not exist"))
        for each in missing
    }
    present = [request for request in chunk.requests if request.world in worlds]
    if present:
        with _crash_is_their_end(present, rows):
            watch, placed = ChunkWatch(), place_chunk(present, worlds, bundles, lanes=lanes, engine=engine)
            rows.update({row.index: row for row in placed.rows})
            for part in placed.parts:
                with _crash_is_their_end([lane.request for lane in part], rows):
                    program = part_program(placed, part, bundles, lanes=lanes, engine=engine)
                    ready = _ready(program, part, placed.worlds, watch)
                    before = len(rows) - len(missing)
                    found = run_ready(ready, should_stop, lambda done, before=before: progress(before + done), recorder)
                    rows.update({row.index: row for row in found})
                watch = ChunkWatch()
    return EpisodeColumns.of([rows[request.index] for request in chunk.requests])


@contextlib.contextmanager
def _crash_is_their_end(requests: Sequence[EpisodeRequest], rows: dict[int, EpisodeResult]) -> Generator[None]:
    """Makes an application's crash the row of each of some episodes that share what crashed."""
    try:
        yield
    except BundleCrash as crash:
        rows.update({request.index: failed_result(request.index, crash.failure) for request in requests})
    except BaseException as exc:
        passed = crash_of(exc, _launches(requests[0]))
        if passed is None:
            raise
        rows.update({request.index: failed_result(request.index, passed.failure) for request in requests})


def _launches(request: EpisodeRequest) -> dict[CrashCode, ApplicationLaunch]:
    return {"RobotApplicationCrash": request.robot, "SimulationApplicationCrash": request.scenario}


def ready_chunk(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
) -> ReadyChunk:
    """Returns episodes made ready to run that share a program and the shapes of their arrays, such as a single one.

    The rest as in ``ready_parts``.

    Raises:
        ValueError: They have several shapes.
    """
    parts = list(ready_parts(requests, worlds, bundles, lanes=lanes, engine=engine))
    if len(parts) != 1:
        raise ValueError(f"{len(requests)} episodes: arrays of {len(parts)} shapes, which run one after the other")
    return parts[0]


def ready_parts(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    beside_m: tuple[float, float] = (0.0, 0.0),
) -> Iterator[ReadyChunk]:
    """Yields episodes of one program made ready to run, those together whose arrays have the same shapes.

    Args:
        requests: Episodes that share a program, at least one.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: At least so many has the program.
        engine: ``auto``, or the engine that must run them.
        beside_m: How far from where the scenario puts it each robot starts (x, y).

    Raises:
        BundleCrash: The applications do not import, or raise when they are traced; or the engine refuses the robot.
    """
    watch, placed = ChunkWatch(), place_chunk(requests, worlds, bundles, lanes=lanes, engine=engine)
    rows = placed.rows
    if not placed.parts:
        yield ReadyChunk(placed.program, [], None, rows, watch)
    for part in placed.parts:
        program = part_program(placed, part, bundles, lanes=lanes, engine=engine)
        moved = [moved_lane(lane, beside_m) for lane in part]
        yield _ready(program, moved, placed.worlds, watch)._replace(rows=rows)
        watch, rows = ChunkWatch(), list[EpisodeResult]()


def _ready(program: Program, part: list[Lane], worlds: Mapping[str, World], watch: ChunkWatch) -> ReadyChunk:
    """Returns lanes of one shape made ready to run, their applications checked."""
    check_applications(program, part[0])
    inputs = stack_lanes(part, program.applications.names, program.lanes)
    run = program.ready(inputs, part, worlds)
    watch.mark()
    return ReadyChunk(program, part, run, [], watch)


def run_ready(
    chunk: ReadyChunk, should_stop: Callable[[], bool], progress: Callable[[int], None], recorder: LaneRecorder | None
) -> list[EpisodeResult]:
    """Returns the rows of episodes that were made ready, those that cannot run first.

    Args:
        chunk: The episodes.
        should_stop: Asked after each slice; episodes not done by then are Canceled.
        progress: Told as often how many episodes are done.
        recorder: Given what the lanes do; None if nothing is recorded.
    """
    if chunk.run is None:
        return chunk.rows
    with open_run(chunk.run):
        if should_stop():
            return chunk.rows + [stopped_row(lane.request) for lane in chunk.lanes]
        drive = _advance_until_done(chunk, chunk.run, should_stop, progress, recorder)
        state, poses = drive.end(), drive.poses
    if drive.done:
        note_timing(chunk.watch.timing(chunk.program.lanes, drawn_by(chunk.run.host)))
    rows = [
        lane_row(chunk.program, chunk.run.host, lane, position, state, poses)
        if state.done[position]
        else stopped_row(lane.request)
        for position, lane in enumerate(chunk.lanes)
    ]
    if recorder is not None:
        recorder.end(lane_ends(chunk.lanes, state), rows)
    return chunk.rows + rows


class LaneDrive:
    """Lanes that were made ready, driven slice by slice: those of a chunk by itself, or of an audit.

    Attributes:
        chunk: The episodes.
        state: The lanes now.
        poses: Of each slice.
    """

    def __init__(self, chunk: ReadyChunk, run: Run) -> None:
        """Begins the lanes."""
        self.chunk, self._run = chunk, run
        self.state, self.poses = run.begin(), list[Poses]()

    @property
    def done(self) -> bool:
        """Returns whether all lanes have ended."""
        return bool(np.all(self.state.done))

    def advance(self) -> StepRecord:
        """Drives a slice; returns what the lanes did in it."""
        self.state, record = self._run.advance(self.state)
        self.poses.append(np.asarray(record.pose))
        self.chunk.watch.mark()
        return record

    def end(self) -> LaneState:
        """Returns the lanes' last state on the host, without the applications' own."""
        return jax.device_get(self.state._replace(controller=None, scenario=None))


def _advance_until_done(
    chunk: ReadyChunk,
    run: Run,
    should_stop: Callable[[], bool],
    progress: Callable[[int], None],
    recorder: LaneRecorder | None,
) -> LaneDrive:
    """Returns the lanes when all are done, or when they shall stop."""
    with timed_call("compile", "", "the first control step, which is compiled before"):
        drive = LaneDrive(chunk, run)
    if recorder is not None:
        recorder.begin(len(chunk.lanes), CONTROL_S)
    before = np.asarray(drive.state.done)
    while not drive.done and not should_stop():
        kind: CallKind = "slice" if drive.poses else "compile"
        with timed_call(kind, "", f"a slice of {SLICE_STEPS} control steps"):
            record = drive.advance()
        done = np.asarray(drive.state.done)
        if recorder is not None:
            # Of a lane that was done before, nothing more is told: others may end earlier, or later.
            recorder.keep(record, np.where(before, -1, np.asarray(drive.state.step)))
            before = done
        progress(len(chunk.rows) + int(np.count_nonzero(done[: len(chunk.lanes)])))
    return drive
