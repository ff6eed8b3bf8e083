"""Simulates a chunk: imports its applications, stages its lanes, runs the program slice by slice, makes rows."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from specs.data.episode import CONTROL_S, ApplicationLaunch, EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.world import World
from tasks.simulate.application.call_clock import CallKind, timed_call
from tasks.simulate.application.code import BundleCrash, CrashCode, crash_of, load_factory
from tasks.simulate.application.contract import Placement
from tasks.simulate.chunk.run_rows import lane_ends, lane_row, open_run
from tasks.simulate.chunk.timings import ChunkWatch, remember_timing
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.choice import choose_engine
from tasks.simulate.engine.engines import ENGINES
from tasks.simulate.engine.program import Program, Run
from tasks.simulate.host.controller_kind import controller_kind
from tasks.simulate.host.controllers import HostBundle
from tasks.simulate.host.kinds import HOST_KINDS
from tasks.simulate.lane.calls import Applications, check_robot, check_scenario
from tasks.simulate.lane.lane_state import LaneState
from tasks.simulate.lane.recording import LaneRecorder
from tasks.simulate.lane.result_rows import stopped_row
from tasks.simulate.lane.staging import (
    Lane,
    Stage,
    last_step,
    moved_lane,
    place,
    stack_lanes,
    stage_worlds,
    with_shortest_paths,
)
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk, ProgramKey, program_key, split_environment
from tasks.simulate.plan.job_variables import without_job_variables
from tasks.simulate.refusal import RobotRefused
from tasks.simulate.sensor.lidar import Lidar
from tasks.simulate.sensor.sensors import read_sensors

_PROGRAMS_KEPT = 8


class ReadyChunk(NamedTuple):
    """Episodes of one program, ready to run.

    Attributes:
        lanes: The episodes that can run, in the lanes' order.
        run: None when no episode can run.
        rows: Of the episodes that cannot.
        watch: Takes the times.
        timed_as: Program to remember them for; None means that of the requests.
    """

    program: Program
    lanes: list[Lane]
    run: Run | None
    rows: list[EpisodeResult]
    watch: ChunkWatch
    timed_as: ProgramKey | None = None


def simulate_episodes(
    chunk: Chunk,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    should_stop: Callable[[], bool],
    progress: Callable[[int], None],
    recorder: LaneRecorder | None = None,
    timed_as: ProgramKey | None = None,
) -> list[EpisodeResult]:
    """Returns a chunk's rows in request order.

    Args:
        chunk: At most ``lanes`` episodes that share a program.
        worlds: By ``<generation>/<world>``; more than the chunk needs are ignored.
        bundles: Unpacked folders of the chunk's applications, by digest.
        lanes: How many lanes every chunk of the batch is padded to.
        engine: ``auto``, or the engine that must run them.
        should_stop: Asked after each slice; episodes not done by then are Canceled.
        progress: Told as often how many of the chunk's episodes are done.
        recorder: Given what the lanes do.
        timed_as: Program to remember the time for, if requests name folders that plans do not know.
    """
    present = [request for request in chunk.requests if request.world in worlds]
    rows = {
        request.index: failed_result(
            request.index, Failure("InvalidS3Resource", f"world {request.world} does not exist")
        )
        for request in chunk.requests
        if request.world not in worlds
    }
    try:
        if present:
            ready = ready_chunk(present, worlds, bundles, lanes=lanes, engine=engine)._replace(timed_as=timed_as)
            rows.update({row.index: row for row in run_ready(ready, should_stop, progress, recorder)})
    except BundleCrash as crash:
        rows.update({request.index: failed_result(request.index, crash.failure) for request in present})
    except BaseException as exc:
        passed = crash_of(exc, _launches(present[0]))
        if passed is None:
            raise
        rows.update({request.index: failed_result(request.index, passed.failure) for request in present})
    return [rows[request.index] for request in chunk.requests]


def _launches(request: EpisodeRequest) -> dict[CrashCode, ApplicationLaunch]:
    return {"RobotApplicationCrash": request.robot, "SimulationApplicationCrash": request.scenario}


def ready_chunk(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    beside_m: tuple[float, float] = (0.0, 0.0),
) -> ReadyChunk:
    """Returns episodes of one program made ready to run.

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
    watch = ChunkWatch()
    program = _program_of(requests[0], bundles, lanes, engine)
    used = {name: worlds[name] for name in dict.fromkeys(request.world for request in requests)}
    stages = stage_worlds(used, program.hull, program.applications.lidar)
    placed, rows = _place_all(program, requests, used, stages)
    ready = [moved_lane(lane, beside_m) for lane in placed]
    if not ready:
        return ReadyChunk(program, ready, None, rows, watch)
    inputs = stack_lanes(ready, program.applications.names, program.lanes)
    one = jax.tree.map(lambda array: array[0], inputs)
    joints = program.body().joints
    check_robot(program.applications, one.floor, one.goals_m, one.numbers, program.actuators, joints=joints)
    check_scenario(program.applications, one.goals_m, one.numbers, one.given)
    run = program.ready(inputs, ready, used)
    watch.mark()
    return ReadyChunk(program, ready, run, rows, watch)


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
        state, poses = _advance_until_done(chunk, chunk.run, should_stop, progress, recorder)
    if np.all(state.done):
        keep_timing(chunk)
    rows = [
        lane_row(chunk.program, chunk.run, lane, position, state, poses)
        if state.done[position]
        else stopped_row(lane.request)
        for position, lane in enumerate(chunk.lanes)
    ]
    if recorder is not None:
        recorder.end(lane_ends(chunk.lanes, state), rows)
    return chunk.rows + rows


def keep_timing(chunk: ReadyChunk) -> None:
    """Remembers what a chunk took that came to its end, for plans to come."""
    requests = [lane.request for lane in chunk.lanes]
    timing = chunk.watch.timing(
        chunk.program.engine,
        device_kind(),
        lanes=chunk.program.lanes,
        episodes=len(requests),
        most_slices=-(-max(last_step(request) for request in requests) // SLICE_STEPS) - 1,
        host=chunk.run is not None and chunk.run.host is not None,
    )
    if timing is not None:
        remember_timing(chunk.timed_as or program_key(requests[0]), timing)


def _program_of(request: EpisodeRequest, bundles: Mapping[str, Path], lanes: int, engine: str) -> Program:
    numbers, texts = split_environment(without_job_variables(request.environment))
    folders = (bundles[request.robot.digest], bundles[request.scenario.digest])
    environment = (tuple(sorted(numbers)), tuple(sorted(texts.items())))
    return _program((request.robot, request.scenario), folders, environment, lanes, engine)


@functools.lru_cache(maxsize=_PROGRAMS_KEPT)
def _program(
    launches: tuple[ApplicationLaunch, ApplicationLaunch],
    folders: tuple[Path, Path],
    environment: tuple[tuple[str, ...], tuple[tuple[str, str], ...]],
    lanes: int,
    engine: str,
) -> Program:
    """Returns the program of two applications; kept, so that a batch's chunks share one compilation.

    Raises:
        BundleCrash: An application does not import, or its robot is refused.
    """
    (robot, scenario), (names, texts) = launches, environment
    bundle = HostBundle(folders[0], robot)
    kind = controller_kind(*bundle)
    host = HOST_KINDS[kind](bundle) if kind in HOST_KINDS else None
    make_controller = host.declare if host else load_factory(*bundle, "controller", "RobotApplicationCrash")
    make_scenario = load_factory(folders[1], scenario, "scenario", "SimulationApplicationCrash")
    sensors = read_sensors(make_controller, {**dict(texts), **dict.fromkeys(names, jnp.ones(()))})
    applications = Applications(make_controller, make_scenario, dict(texts), names, sensors)
    try:
        choice = choose_engine(engine, bundle.robot, kind, device_kind())
        return ENGINES[choice.engine].load(bundle.robot, applications, lanes, host)
    except RobotRefused as refused:
        raise BundleCrash("RobotApplicationCrash", f"{robot.name}: {refused}") from refused


def _place_all(
    program: Program, requests: Sequence[EpisodeRequest], worlds: Mapping[str, World], stages: Mapping[str, Stage]
) -> tuple[list[Lane], list[EpisodeResult]]:
    """Returns the episodes that have a start and goals, and rows for those whose scenario failed to give them."""
    placed: list[tuple[EpisodeRequest, Stage, Placement]] = []
    rows: list[EpisodeResult] = []
    lidars: dict[int, Lidar] = {}
    for request in requests:
        numbers, texts = split_environment(request.environment)
        environment = {**texts, **{name: jnp.float32(value) for name, value in numbers.items()}}
        try:
            lidars[request.index] = program.applications.episode_sensors(environment).lidar
            scenario = program.applications.placing_scenario(environment)
            stage = stages[request.world]
            placement = place(scenario, request, worlds[request.world], stage, program.hull)
            _require_same_shapes(placement, placed)
        except BundleCrash as crash:
            rows.append(failed_result(request.index, crash.failure))
        else:
            placed.append((request, stage, placement))
    lanes = with_shortest_paths(placed, program.hull)
    return [lane._replace(lidar=lidars[lane.request.index]) for lane in lanes], rows


def _require_same_shapes(placement: Placement, placed: Sequence[tuple[EpisodeRequest, Stage, Placement]]) -> None:
    first = placed[0][2] if placed else placement
    shapes, others = ([(each.shape, each.dtype.name) for each in one.given] for one in (placement, first))
    if shapes != others:
        raise BundleCrash(
            "SimulationApplicationCrash", f"scenario.place: given of {shapes}, where other episodes have {others}"
        )


def _advance_until_done(
    chunk: ReadyChunk,
    run: Run,
    should_stop: Callable[[], bool],
    progress: Callable[[int], None],
    recorder: LaneRecorder | None,
) -> tuple[LaneState, list[Float32[np.ndarray, "lanes steps 3"]]]:
    """Returns the lanes' last state, without the applications' own, and the poses of each slice."""
    with timed_call("compile", "", "the first control step, which is compiled before"):
        state = run.begin()
    if recorder is not None:
        recorder.begin(len(chunk.lanes), CONTROL_S)
    poses: list[Float32[np.ndarray, "lanes steps 3"]] = []
    while not np.all(state.done) and not should_stop():
        kind: CallKind = "slice" if poses else "compile"
        with timed_call(kind, "", f"a slice of {SLICE_STEPS} control steps"):
            state, record = run.advance(state)
            poses.append(np.asarray(record.pose))
        chunk.watch.mark()
        if recorder is not None:
            recorder.keep(record, np.asarray(state.step))
        progress(len(chunk.rows) + int(np.count_nonzero(np.asarray(state.done)[: len(chunk.lanes)])))
    return jax.device_get(state._replace(controller=None, scenario=None)), poses
