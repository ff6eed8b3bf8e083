"""Chunks under way together: rows and recordings are those of chunks simulated by themselves, and nothing is traced."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk import chunk_pipeline as pipeline_module
from tasks.simulate.chunk import lane_pool
from tasks.simulate.chunk.byproducts import collect_timings
from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline
from tasks.simulate.chunk.lane_pool import PendingChunk
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.lane.staging import Lane, with_shortest_paths
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tests.factories.simulations import FOLDERS, pushing, simulate_lanes

LANES = 32
RATE_HZ = 4.0
# Most robots are done early: their lanes would rest. Some end with a slice.
DURATIONS_S = (1.0, 1.25, 1.0, 0.6, 6.0, 1.0, 2.5, 1.0)
CHUNKS = plan_chunks(
    [
        pushing(k, world=f"hand/pen-{k % 3}", seed=k, fault=str(k % 2), duration_s=DURATIONS_S[k % len(DURATIONS_S)])
        for k in range(5 * LANES - 3)
    ],
    LANES,
)
TRACED = "/jax/core/compile/jaxpr_trace_duration"


class Driven(NamedTuple):
    """What chunks gave, and what it took."""

    rows: list[EpisodeResult]
    recorded: list[dict[str, bytes]]
    slices: int
    traced: list[int]


@pytest.fixture(scope="module")
def traces() -> Iterator[list[str]]:
    """Grows by one with each function that JAX traces."""
    found: list[str] = []

    def tell(event: str, duration_secs: float, **_: str | int) -> None:
        if event == TRACED:
            found.append(event)

    jax.monitoring.register_event_duration_secs_listener(tell)
    yield found
    jax.monitoring.unregister_event_duration_listener(tell)


def drive(pens: dict[str, World], traces: list[str], pipeline: ChunkPipeline | None, ahead: int = 2) -> Driven:
    rows: list[EpisodeResult] = []
    recorded: list[dict[str, bytes]] = []
    traced: list[int] = []
    with collect_timings() as timings:
        for place, chunk in enumerate(CHUNKS):
            recorder, before = Recorder(RATE_HZ, lambda row: row.index % 3 == 0), len(traces)
            rows += simulate_lanes(
                chunk,
                pens,
                FOLDERS,
                lanes=LANES,
                should_stop=lambda: False,
                recorder=recorder,
                pipeline=pipeline,
                ahead=CHUNKS[place + 1 : place + 1 + ahead],
            )
            traced.append(len(traces) - before)
            recorded += [{name: part[name].tobytes() for name in part} for part in recorder.parts()]
    return Driven(rows, recorded, sum(1 + each.slices for each in timings), traced)


@pytest.fixture(scope="module")
def alone(pens: dict[str, World], traces: list[str]) -> Driven:
    return drive(pens, traces, None)


@pytest.fixture(scope="module")
def together(pens: dict[str, World], traces: list[str]) -> Driven:
    return drive(pens, traces, ChunkPipeline())


@pytest.mark.long
def test_rows_are_those_of_chunks_by_themselves(alone: Driven, together: Driven):
    assert {row.outcome_reason for row in alone.rows} >= {"timeout"}
    assert together.rows == alone.rows


def test_recordings_are_the_same_bytes(alone: Driven, together: Driven):
    assert len(alone.recorded) == len(CHUNKS)
    assert together.recorded == alone.recorded


def test_lanes_that_are_done_take_the_next_episodes(alone: Driven, together: Driven):
    assert together.slices <= 0.7 * alone.slices


def test_nothing_is_traced_after_the_first_chunk(alone: Driven, together: Driven):
    assert together.traced[0] > 0
    assert together.traced[1:] == [0] * (len(CHUNKS) - 1)
    assert alone.traced[1:] == [0] * (len(CHUNKS) - 1)


def one(
    chunk: Chunk, pens: dict[str, World], pipeline: ChunkPipeline, ahead: Sequence[Chunk] = (), stop_after: int = 99
):
    asked: list[int] = []

    def should_stop() -> bool:
        asked.append(0)
        return len(asked) > stop_after

    return simulate_lanes(
        chunk, pens, FOLDERS, lanes=LANES, should_stop=should_stop, pipeline=pipeline, ahead=ahead
    )  # fmt: skip


def test_what_was_simulated_before_it_is_asked_for_is_the_same(alone: Driven, pens: dict[str, World]):
    pipeline = ChunkPipeline()
    first = one(CHUNKS[0], pens, pipeline, CHUNKS[1:2])
    for _ in range(50):
        pipeline.work_ahead()
    second = one(CHUNKS[1], pens, pipeline, stop_after=0)
    assert first + second == alone.rows[: 2 * LANES]


@pytest.mark.long
def test_another_chunk_than_was_expected_is_simulated_all_the_same(alone: Driven, pens: dict[str, World]):
    pipeline = ChunkPipeline()
    one(CHUNKS[0], pens, pipeline, CHUNKS[1:3])
    assert one(CHUNKS[3], pens, pipeline, CHUNKS[4:]) == alone.rows[3 * LANES : 4 * LANES]


@pytest.mark.long
def test_a_chunk_that_is_stopped_keeps_the_rows_of_what_was_done_and_the_next_begins_anew(
    alone: Driven, pens: dict[str, World]
):
    pipeline = ChunkPipeline()
    rows = one(CHUNKS[0], pens, pipeline, CHUNKS[1:3], stop_after=2)
    done = [row for row in rows if row.status != "Canceled"]
    assert 0 < len(done) < LANES
    assert done == [alone.rows[row.index] for row in done]
    assert not pipeline.work_ahead()
    assert one(CHUNKS[1], pens, pipeline) == alone.rows[LANES : 2 * LANES]


@pytest.mark.long
@pytest.mark.parametrize("launch", ["unimportable", "growing"])
def test_a_chunk_ahead_that_cannot_run_takes_no_row_from_the_chunk_before_it(
    alone: Driven, pens: dict[str, World], launch: str
):
    pipeline = ChunkPipeline()
    (broken,) = plan_chunks([pushing(k, world="hand/pen-0", launch=launch) for k in range(4)], LANES)
    assert one(CHUNKS[0], pens, pipeline, [broken]) == alone.rows[:LANES]
    assert {row.failure_code for row in one(broken, pens, pipeline)} == {"RobotApplicationCrash"}


@pytest.mark.long
def test_a_world_that_is_missing_is_the_row_of_its_episodes(alone: Driven, pens: dict[str, World]):
    known = {name: world for name, world in pens.items() if name != "hand/pen-1"}
    rows = one(CHUNKS[0], known, ChunkPipeline(), CHUNKS[1:2])
    missing = [row.index for row in rows if row.failure_code == "InvalidS3Resource"]
    assert missing == [row.index for row in rows if row.index % 3 == 1]
    assert np.all([rows[k] == alone.rows[k] for k in range(LANES) if k not in missing])


def _small_chunks(*durations_s: tuple[float, ...]) -> list[Chunk]:
    indices, found = iter(range(99)), list[Chunk]()
    for number, some_s in enumerate(durations_s):
        requests = [
            pushing(next(indices), world="hand/pen-0", seed=k, duration_s=seconds) for k, seconds in enumerate(some_s)
        ]
        found.append(Chunk(number=number, requests=tuple(requests)))
    return found


def test_a_slice_that_is_on_its_way_when_a_chunk_is_asked_for_that_is_done_counts(pens: dict[str, World]):
    chunks, pipeline = _small_chunks((3.0,), (1.0, 1.0), (7.0, 6.0)), ChunkPipeline()
    together = [one(chunk, pens, pipeline, chunks[chunk.number + 1 :]) for chunk in chunks]
    assert together == [one(chunk, pens, ChunkPipeline()) for chunk in chunks]


def test_chunks_with_more_samples_than_may_be_kept_are_simulated_one_by_one(
    monkeypatch: pytest.MonkeyPatch, alone: Driven, pens: dict[str, World], traces: list[str]
):
    monkeypatch.setattr(pipeline_module, "_KEPT_BYTES", 100)
    pipeline = ChunkPipeline()
    assert drive(pens, traces, pipeline) == alone._replace(traced=[0] * len(CHUNKS))
    assert not pipeline.work_ahead()


def test_episodes_for_which_there_are_free_lanes_drive_before_their_ways_are_measured(
    pens: dict[str, World], monkeypatch: pytest.MonkeyPatch
):
    chunks, events = _small_chunks((1.0, 2.0), (1.0, 2.0)), list[str]()
    number = {request.index: chunk.number for chunk in chunks for request in chunk.requests}
    wait = PendingChunk.wait_for_lanes

    def waited(work: PendingChunk) -> None:
        events.append(f"chunk {work.chunk.number} waits for lanes")
        wait(work)

    def measured(lanes: Sequence[Lane]) -> list[Lane]:
        events.append(f"chunk {number[lanes[0].request.index]} is measured")
        return with_shortest_paths(lanes)

    monkeypatch.setattr(PendingChunk, "wait_for_lanes", waited)
    monkeypatch.setattr(lane_pool, "with_shortest_paths", measured)
    pipeline = ChunkPipeline()
    for chunk in chunks:
        one(chunk, pens, pipeline, chunks[chunk.number + 1 :])
    for chunk in chunks:
        waits, is_measured = (
            events.index(f"chunk {chunk.number} {what}") for what in ("waits for lanes", "is measured")
        )
        assert waits < is_measured
