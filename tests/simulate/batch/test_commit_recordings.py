"""Recordings are written before the chunk that names them, and only of episodes that are wanted."""

from collections.abc import Iterable
from typing import Literal

import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from specs.pipeline.simulation_section import Recordings
from tasks.simulate.batch.batch_jobs import cancel_job, restart_job
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.lane.lane_state import StepRecord
from tasks.simulate.lane.recording import Columns, Ends, RecordingChoice
from tasks.storage.base.store import Store
from tests.factories.episodes import collided
from tests.factories.planned_batches import begun, mixed, plan, template


class Recorded:
    """A simulator that records the pose and goal of each lane, and what was written of it."""

    def __init__(self) -> None:
        self.written: dict[int, list[int]] = {}

    def simulate(self, part: ChunkPart) -> list[EpisodeResult]:
        rows = mixed(part)
        assert part.recorder
        lanes = len(rows)
        one = np.zeros((lanes, 1, 3), np.float32)
        part.recorder.begin(lanes, 0.05)
        part.recorder.keep(StepRecord(one, one, one[:, :, 0], one, one, one[:, :, 0]), np.ones(lanes, int))  # pyright: ignore[reportArgumentType]
        none, lidars = np.zeros(lanes, int), np.zeros((lanes, 7))
        done = Ends(np.ones(lanes, int), none == 1, one[:, 0], one[:, 0], one[:, 0], none, one[:, :, :2], lidars)
        part.recorder.end(done, rows)
        return rows

    def write(self, number: int, parts: Iterable[Columns]) -> str:
        found = [int(index) for part in parts for index in part["index"]]
        self.written[number] = list(dict.fromkeys(found))
        return f"{number}.parquet" if found else ""


@pytest.mark.parametrize(
    ("changes", "kept"),
    [
        ({}, [1, 3]),
        ({"recordings": Recordings(episodes="all")}, [0, 1, 2, 3]),
        ({"recordings": Recordings(episodes="none")}, []),
        ({"recordings": Recordings(episodes="none"), "templates": (template(record=True),)}, [0, 1, 2, 3]),
    ],
)
def test_episodes_that_failed_are_recorded_and_those_that_were_asked_for(
    file_store: Store, changes: dict[str, object], kept: list[int]
):
    batch, recorded = begun(file_store, plan(file_store, **changes)), Recorded()
    run_chunk(batch, 0, recorded.simulate, recorded.write, lanes=2, left_s=9.0)
    assert recorded.written == {0: kept}
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.index for row in rows if row.recording == "0.parquet"] == kept
    assert {row.recording for row in rows} <= {"", "0.parquet"}


@pytest.mark.parametrize(("episodes", "always"), [("failed", ()), ("all", (0, 1, 2, 3)), ("none", ())])
def test_a_part_says_which_of_its_episodes_are_recorded(
    file_store: Store, episodes: Literal["failed", "all", "none"], always: tuple[int, ...]
):
    batch = begun(file_store, plan(file_store, recordings=Recordings(episodes=episodes)))
    said: list[RecordingChoice | None] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        said.append(part.recorded)
        return mixed(part)

    run_chunk(batch, 0, simulate, Recorded().write, lanes=4, left_s=9.0)
    assert said == [RecordingChoice(always=always, failed=episodes == "failed")]


def test_the_parts_of_a_chunk_share_the_memory_for_samples(file_store: Store):
    batch, recorded = begun(file_store), Recorded()
    held: list[object] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        assert part.recorder
        held.append(part.recorder._overflow)
        return recorded.simulate(part)

    run_chunk(batch, 0, simulate, recorded.write, lanes=2, left_s=9.0)
    assert len(held) == 2
    assert held[0] is held[1]


def test_a_recording_is_written_before_the_chunk_that_names_it(file_store: Store):
    batch, recorded = begun(file_store), Recorded()

    def dies(number: int, parts: Iterable[Columns]) -> str:
        assert committed_chunk(file_store, batch.id, number) is None
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_chunk(batch, 0, recorded.simulate, dies, lanes=4, left_s=9.0)
    assert committed_chunk(file_store, batch.id, 0) is None


def test_a_cancelled_job_leaves_no_recording(file_store: Store):
    batch, recorded = begun(file_store), Recorded()
    cancel_job(file_store, f"{batch.id}/1")

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        part.watch()
        return recorded.simulate(part)

    run_chunk(batch, 0, simulate, recorded.write, lanes=4, left_s=9.0)
    assert recorded.written == {0: [3]}


def test_who_is_cancelled_while_recordings_are_written_is_canceled_and_leaves_none(file_store: Store):
    batch, recorded = begun(file_store), Recorded()

    def slow(number: int, parts: Iterable[Columns]) -> str:
        name = recorded.write(number, parts)
        if recorded.written[number] == [1, 3]:
            for index in (0, 1):
                cancel_job(file_store, f"{batch.id}/{index}")
        return name

    run_chunk(batch, 0, recorded.simulate, slow, lanes=4, left_s=9.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.status for row in rows[:3]] == ["Canceled", "Canceled", "Completed"]
    assert recorded.written == {0: [3]}
    assert [row.recording for row in rows] == ["", "", "", "0.parquet"]


def test_who_is_restarted_while_recordings_are_written_runs_once_more(file_store: Store):
    batch, recorded = begun(file_store), Recorded()
    parts_run: list[list[int]] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        parts_run.append([request.index for request in part.chunk.requests])
        return recorded.simulate(part) if part.recorder else [collided(1)]

    def slow(number: int, parts: Iterable[Columns]) -> str:
        restart_job(file_store, f"{batch.id}/1")
        return recorded.write(number, parts)

    run_chunk(batch, 0, simulate, slow, lanes=4, left_s=9.0)
    assert parts_run == [[0, 1, 2, 3], [1]]
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.recording for row in rows] == ["", "0.parquet", "", "0.parquet"]
