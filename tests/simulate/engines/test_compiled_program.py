"""One program for all worlds: what a batch adds besides applications compiles nothing more."""

import logging
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float32

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.contract import Observation
from tasks.simulate.chunk.chunk_simulation import ReadyChunk, ready_chunk
from tasks.simulate.chunk.lane_pool import lane_row
from tasks.simulate.engines.compiled_program import CompiledProgram, SensedColumns, compiled_program
from tasks.simulate.engines.program import Run
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.host.controllers import HostApplication
from tasks.simulate.lane.control_step import LaneState, StepRecord
from tasks.simulate.lane.staging import stack_lanes
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, PLAIN, cluttered, delivery, pen, pushing, simulate_lanes

COMPILED = "Finished XLA compilation"
LANES = 16
FIRST = {"hand/first": cluttered(0)}


def run(requests: list[EpisodeRequest], worlds: dict[str, World], engine: str) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, LANES)
    return simulate_lanes(chunk, worlds, FOLDERS, lanes=LANES, engine=engine, should_stop=lambda: False)


@pytest.fixture(
    params=["mujoco", pytest.param("planar", marks=pytest.mark.long), pytest.param("mjx", marks=pytest.mark.soak)]
)
def engine(request: pytest.FixtureRequest) -> str:
    """An engine that has simulated a chunk in one world."""
    run([delivery(k, world="hand/first", seed=k, duration_s=1.0) for k in range(LANES)], FIRST, request.param)
    return request.param


def test_worlds_seeds_numbers_and_durations_compile_nothing(engine: str, caplog: pytest.LogCaptureFixture):
    worlds = {"hand/pen": pen(6.0, 1), "hand/bare": pen(5.0, 2).model_copy(update={"furniture": ()})}
    worlds |= {f"hand/apartment-{seed}": cluttered(seed) for seed in range(1, 5)}
    assert len({len(obstacles(world, 0.02, 0.38).boxes) for world in worlds.values()}) >= 3
    others = [
        delivery(k, world=name, seed=100 + k, speed=f"0.{3 + k}", duration_s=1.0 + 0.5 * k)
        for k, name in enumerate(worlds)
    ]
    with jax.log_compiles(), caplog.at_level(logging.WARNING, logger="jax"):
        rows = run(others, worlds, engine)
        compiled = [record.message for record in caplog.records if COMPILED in record.message]
        jax.jit(lambda x: 5 * x)(1.0)
    assert {(row.status, row.engine) for row in rows} == {("Completed", engine)}
    assert compiled == []
    assert any(COMPILED in record.message for record in caplog.records)  # JAX still says so in these words


WANDERER = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="wandering")
LONGEST_S = 6.0


class Driven(NamedTuple):
    """What a run gave: the last state, all records, and the rows."""

    state: LaneState
    record: StepRecord
    rows: list[EpisodeResult]


class Replay:
    """Gives the controls that were recorded, and keeps what it was shown."""

    crashes: Mapping[int, str] = {}
    cancelled: frozenset[int] = frozenset()

    def __init__(self, recorded: Float32[np.ndarray, "lanes steps nu"]) -> None:
        self.seen: list[tuple[Observation, np.ndarray]] = []
        self._recorded = recorded

    def controls(self, observed: Observation, moving: np.ndarray) -> np.ndarray:
        self.seen.append((observed, moving))
        return self._recorded[:, len(self.seen) - 1]

    def measures(self, lane: int) -> Mapping[str, int]:  # noqa: ARG002 - as of all controllers on the host
        return {}

    def close(self) -> None:
        """Holds nothing."""


def wandering(index: int) -> EpisodeRequest:
    fault = {5: "1", 6: "2"}.get(index, "0")
    drawn = pushing(
        index, world=f"hand/pen-{index % 3}", seed=index, fault=fault, duration_s=LONGEST_S - 0.35 * (index % 4)
    )
    return drawn.model_copy(update={"robot": WANDERER})


def driven(chunk: ReadyChunk, run: Run) -> Driven:
    state, records = run.begin(), list[StepRecord]()
    while not np.all(state.done):
        state, record = run.advance(state)
        records.append(jax.tree.map(np.asarray, record))
    whole: StepRecord = jax.tree.map(lambda *each: np.concatenate(each, axis=1), *records)
    end = jax.device_get(state._replace(controller=None))
    rows = [
        lane_row(chunk.program, run.host, lane, place, end, [np.asarray(whole.pose)])
        for place, lane in enumerate(chunk.lanes)
    ]
    return Driven(end, whole, rows)


class Both(NamedTuple):
    """The same controls, decided in the fused loop and then given by the host."""

    fused: Driven
    stepwise: Driven
    replay: Replay
    lanes: int


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(("planar", 8), marks=pytest.mark.long),
        pytest.param(("planar", 24), marks=pytest.mark.long),
        pytest.param(("mjx", 8), marks=pytest.mark.soak),
    ],
    ids=lambda param: f"{param[0]}-{param[1]}",
)
def both(request: pytest.FixtureRequest, pens: dict[str, World]) -> Both:
    engine, lanes = request.param
    chunk = ready_chunk([wandering(k) for k in range(lanes)], pens, FOLDERS, lanes=lanes, engine=engine)
    assert isinstance(chunk.program, CompiledProgram)
    assert chunk.run is not None
    fused = driven(chunk, chunk.run)
    seen, replay = chunk.program.applications, Replay(np.asarray(fused.record.control))
    host = HostApplication("plain", seen.make_controller, lambda _: replay)
    program = compiled_program(chunk.program.mechanics, seen, lanes, host)
    run = program.ready(stack_lanes(chunk.lanes, seen.names, program.lanes), chunk.lanes, pens)
    return Both(fused, driven(chunk, run), replay, lanes)


def same_bits(one: object, other: object) -> bool:
    return all(
        np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    )


def test_the_rows_are_the_same(both: Both):
    assert both.stepwise.rows == both.fused.rows
    assert {row.status for row in both.fused.rows} == {"Completed", "Failed"}
    assert len({row.simulated_s for row in both.fused.rows}) > 3
    assert any(row.collisions for row in both.fused.rows)


def test_the_last_states_are_the_same_bits(both: Both):
    assert same_bits(both.stepwise.state, both.fused.state)


def test_the_records_of_all_steps_that_lanes_drove_are_the_same_bits(both: Both):
    for lane, steps in enumerate(both.fused.state.step[: both.lanes].tolist()):
        one, other = (
            jax.tree.map(lambda array, lane=lane, steps=steps: array[lane, :steps], each.record)
            for each in (both.stepwise, both.fused)
        )
        assert same_bits(one, other)


def test_it_ends_with_the_last_lane(both: Both):
    assert both.stepwise.record.pose.shape[1] == int(both.fused.state.step.max())


def test_the_host_sees_what_the_robots_sense_in_its_own_types(both: Both):
    first, moving = both.replay.seen[0]
    assert {name: array.dtype.kind for name, array in first._asdict().items() if array is not None} == {
        **dict.fromkeys(("time_s", "pose", "velocity", "ranges_m", "goal_m", "goal_robot_m"), "f"),
        "goal_index": "i",
        "bumper": "b",
    }
    assert moving.tolist() == [lane < both.lanes for lane in range(len(moving))]
    for step, (observed, moving) in enumerate(both.replay.seen):
        assert same_bits(observed.ranges_m[moving], both.stepwise.record.ranges_m[moving, step])
        assert observed.time_s[moving] == pytest.approx(0.05 * step)


def test_a_lane_that_is_done_moves_no_more(both: Both):
    after = [moving.sum() for _, moving in both.replay.seen]
    assert after == sorted(after, reverse=True)
    assert not both.replay.seen[-1][1][5]


def test_rows_of_numbers_are_taken_apart_as_they_were_put_together():
    three, two = jnp.zeros((2, 3)), jnp.zeros((2, 2))
    form = Observation(
        time_s=jnp.zeros(2),
        pose=three,
        velocity=three,
        ranges_m=jnp.zeros((2, 4)),
        goal_index=jnp.zeros(2, jnp.int32),
        goal_m=two,
        goal_robot_m=two,
        bumper=jnp.zeros((2, 3), bool),
    )
    rows = np.arange(2 * 20, dtype=np.float32).reshape(2, 20)
    columns = SensedColumns(form)
    observed, done = columns.observed(rows), columns.done(rows)
    assert observed.ranges_m.tolist() == [[0, 1, 2, 3], [20, 21, 22, 23]]
    assert done.tolist() == [True, True]
    assert (observed.time_s.tolist(), observed.goal_index.tolist()) == ([5, 25], [12, 32])
    assert (observed.goal_robot_m[1].tolist(), observed.bumper.shape) == ([35, 36], (2, 3))
