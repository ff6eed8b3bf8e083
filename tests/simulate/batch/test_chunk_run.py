"""A chunk is committed whole and once, and whatever goes wrong in it is a row of its own."""

import errno
from collections.abc import Callable, Iterable, Mapping
from typing import Literal

import numpy as np
import pytest

from specs.arn import Reference
from specs.data.episode import EpisodeResult, Failure, failed_result, unfinished_result
from specs.errors import BundleRefused, StoreAway
from specs.pipeline.simulation_section import Recordings
from tasks.simulate.batch import chunk_run
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import (
    ChunkPart,
    PreparedChunk,
    coming_chunks,
    forget_chunks,
    prepared_chunk,
    run_chunk,
    tag_jobs,
)
from tasks.simulate.batch.chunk_store import chunk_numbers, chunk_start, committed_chunk, spent_s
from tasks.simulate.batch.result_stream import result_parts
from tasks.simulate.chunk.byproducts import ChunkTiming, note_timing
from tasks.simulate.data.data_sources import PinnedSource
from tasks.simulate.lane.control_step import StepRecord
from tasks.simulate.lane.recording import Columns, Ends, RecordingChoice
from tasks.simulate.lane.result_rows import WITHDRAWN
from tasks.simulate.plan.chunks import JOB_ID
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of
from tests.factories.episodes import passed
from tests.factories.planned_batches import all_pass, begun, mixed, plan, put_world, stops_after, template


def refuse(part: ChunkPart) -> list[EpisodeResult]:
    pytest.fail("simulated again")


def test_a_committed_chunk_is_not_simulated_again(file_store: Store):
    batch = begun(file_store)
    assert run_chunk(batch, 1, mixed, lanes=4, left_s=3600.0).episodes == 2
    before = committed_chunk(file_store, batch.id, 1)
    assert run_chunk(batch, 1, refuse, lanes=4, left_s=3600.0).episodes == 2
    assert committed_chunk(file_store, batch.id, 1) == before
    assert committed_chunk(file_store, batch.id, 0) is None


def test_the_record_names_the_gl_that_drew_a_chunk(file_store: Store):
    def drawn(part: ChunkPart) -> list[EpisodeResult]:
        note_timing(ChunkTiming(lanes=4, ready_s=0, compile_s=0, slices=1, slices_s=0, peak_bytes=0, gl="egl: one"))
        return all_pass(part)

    batch = begun(file_store)
    run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    assert "gl/egl: one" not in batch.record().detail
    run_chunk(batch, 1, drawn, lanes=4, left_s=3600.0)
    assert "gl/egl: one" in batch.record().detail


def test_of_two_processes_the_first_to_commit_decides(file_store: Store):
    batch = begun(file_store)

    def slow(part: ChunkPart) -> list[EpisodeResult]:
        run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
        return mixed(part)

    run_chunk(batch, 0, slow, lanes=4, left_s=3600.0)
    assert [row.outcome for row in committed_chunk(file_store, batch.id, 0) or ()] == ["Passed"] * 4


def test_each_episode_is_told_which_job_it_is(file_store: Store):
    batch, told = begun(file_store), list[str]()

    def look(part: ChunkPart) -> list[EpisodeResult]:
        told.extend(each.environment[JOB_ID] for each in part.chunk.requests)
        return all_pass(part)

    run_chunk(batch, 1, look, lanes=4, left_s=3600.0)
    own = batch.id.removeprefix("simb-")
    assert told == [f"sim-{own}4", f"sim-{own}5"]


def test_each_beginning_is_counted_with_what_was_spent_before(file_store: Store):
    batch = begun(file_store)

    def dies(part: ChunkPart) -> list[EpisodeResult]:
        raise KeyboardInterrupt

    for spent in (1.5, 2.5):
        with pytest.raises(KeyboardInterrupt):
            run_chunk(batch, 0, dies, lanes=4, left_s=3600.0, spent_s=spent)
    start = chunk_start(file_store, batch.id, 0)
    assert start
    assert (start.attempts, start.spent_s, spent_s(file_store, batch.id)) == (2, 2.5, 2.5)
    assert chunk_numbers(file_store, batch.id).begun == {0}
    assert not chunk_numbers(file_store, batch.id).committed


def test_a_chunk_whose_process_died_again_is_tried_with_fewer_lanes(file_store: Store):
    batch = begun(file_store, plan(file_store, lanes=64, seeds=tuple(range(64)), worlds=("g/w0",)))
    tried: list[int] = []

    def dies_with_many(part: ChunkPart) -> list[EpisodeResult]:
        tried.append(part.lanes)
        if part.lanes > 16:
            raise KeyboardInterrupt
        return all_pass(part)

    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            run_chunk(batch, 0, dies_with_many, lanes=64, left_s=3600.0)
    assert run_chunk(batch, 0, dies_with_many, lanes=64, left_s=3600.0)[:2] == (64, 16)
    assert tried == [64, 64, 32, *[16] * 4]
    assert [row.index for row in committed_chunk(file_store, batch.id, 0) or ()] == list(range(64))


def test_a_world_that_is_gone_fails_its_episodes_and_no_others(file_store: Store):
    batch = begun(file_store)
    file_store.delete(world_key("g", "w0"))
    run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [(row.status, row.failure_code) for row in rows] == [
        *[("Failed", "InvalidS3Resource")] * 3,
        ("Completed", ""),
    ]
    assert "g/w0" in rows[0].failure_reason


def test_a_world_that_was_changed_after_planning_is_not_simulated(file_store: Store):
    made = plan(file_store)
    batch = begun(file_store, made.model_copy(update={"world_digests": {**made.world_digests, "g/w1": "0" * 64}}))
    run_chunk(batch, 0, all_pass, lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.failure_code for row in rows] == ["", "", "", "MismatchedEtag"]


def test_when_time_is_over_what_is_done_keeps_its_row_and_the_batch_begins_nothing_more(file_store: Store):
    batch = begun(file_store)
    run_chunk(batch, 0, stops_after(1), lanes=4, left_s=-1.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.status for row in rows] == ["Completed", *["Canceled"] * 3]
    assert {row.failure_code for row in rows[1:]} == {"BatchTimedOut"}
    assert batch.record().status == "TimingOut"


def test_time_that_is_over_when_all_is_done_anyway_stops_nothing(file_store: Store):
    batch = begun(file_store)
    run_chunk(batch, 0, stops_after(4), lanes=4, left_s=-1.0)
    assert {row.status for row in committed_chunk(file_store, batch.id, 0) or ()} == {"Completed"}
    assert batch.record().status == "InProgress"


def test_a_cancelled_batch_stops_and_keeps_what_is_done(file_store: Store):
    batch = begun(file_store)
    cancel_batch(file_store, batch.id)
    run_chunk(batch, 0, stops_after(2), lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.failure_code for row in rows] == ["", "", "BatchCanceled", "BatchCanceled"]


def test_a_cancelled_job_is_canceled_alone(file_store: Store):
    batch = begun(file_store)
    cancel_job(file_store, f"{batch.id}/2")
    run_chunk(batch, 0, stops_after(0), lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.status for row in rows] == ["Completed", "Completed", "Canceled", "Completed"]
    assert [rows[0], rows[1], rows[3]] == [passed(0), passed(1), passed(3)]
    assert rows[2].failure_code == ""


def test_a_chunk_whose_jobs_are_all_cancelled_stops(file_store: Store):
    batch = begun(file_store)
    for index in (4, 5):
        cancel_job(file_store, f"{batch.id}/{index}")
    run_chunk(batch, 1, stops_after(0), lanes=4, left_s=3600.0)
    assert {row.status for row in committed_chunk(file_store, batch.id, 1) or ()} == {"Canceled"}
    assert batch.record().status == "InProgress"


@pytest.mark.parametrize("code", ["BatchCanceled", "BatchTimedOut"])
def test_results_come_by_index_and_what_was_not_begun_is_canceled(file_store: Store, code: str):
    sweep = {"MODE": ("fast", "slow")}
    batch = begun(file_store, plan(file_store, sweep=sweep, templates=(template(), template())))
    for number in (0, 2, 4):
        run_chunk(batch, number, mixed, lanes=4, left_s=-1.0 if code == "BatchTimedOut" else 3600.0)
    if code == "BatchCanceled":
        cancel_batch(file_store, batch.id)
    else:
        run_chunk(batch, 1, stops_after(0), lanes=4, left_s=-1.0)
    found = [
        pair
        for requests, results in result_parts(batch, batch.record().status)
        for pair in zip(requests, results, strict=True)
    ]
    assert [request.index for request, _ in found] == list(range(24))
    assert [result.index for _, result in found] == list(range(24))
    done = {each.index for number in (0, 2, 4) for each in batch.layout.chunk(number).requests}
    assert {result.index for _, result in found if result.failure_code == code} == set(range(24)) - done


def test_a_part_holds_some_episodes_however_chunks_lie(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tasks.simulate.batch.result_stream.PART_EPISODES", 5)
    batch = begun(file_store, plan(file_store, sweep={"MODE": ("fast", "slow")}, lanes=3))
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, mixed, lanes=3, left_s=3600.0)
    sizes = [(len(requests), len(results)) for requests, results in result_parts(batch, batch.record().status)]
    assert sizes == [(5, 5), (5, 5), (2, 2)]


def test_who_is_cancelled_right_after_the_last_look_is_canceled_all_the_same(file_store: Store):
    batch = begun(file_store)

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        rows = all_pass(part)  # looks; the next look of its own would be in a second
        cancel_job(file_store, f"{batch.id}/2")
        return rows

    run_chunk(batch, 0, simulate, lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.status for row in rows] == ["Completed", "Completed", "Canceled", "Completed"]


def test_the_same_world_is_read_again_when_it_comes_back(file_store: Store):
    batch = begun(file_store, name="first")
    file_store.delete(world_key("g", "w1"))
    run_chunk(batch, 1, all_pass, lanes=4, left_s=3600.0)
    put_world(file_store, "g/w1")
    again = begun(file_store, name="second")
    run_chunk(again, 1, all_pass, lanes=4, left_s=3600.0)
    assert {row.status for row in committed_chunk(file_store, batch.id, 1) or ()} == {"Failed"}
    assert {row.status for row in committed_chunk(file_store, again.id, 1) or ()} == {"Completed"}


def test_the_log_tells_why_jobs_of_a_chunk_failed_each_reason_once(file_store: Store, caplog: pytest.LogCaptureFixture):
    def crash(part: ChunkPart) -> list[EpisodeResult]:
        why = Failure("RobotApplicationCrash", "controller.step: KeyError: '\x1b[2Jx' (nav/nav.py, line 3: ways['x'])")
        return [failed_result(request.index, why) for request in part.chunk.requests]

    run_chunk(begun(file_store), 0, crash, lanes=4, left_s=3600.0)
    assert caplog.messages == [
        "chunk 0: 4 failed: RobotApplicationCrash: controller.step: KeyError: '[2Jx' (nav/nav.py, line 3: ways['x'])"
    ]


def test_the_log_tells_of_jobs_in_which_lock_step_did_not_hold(file_store: Store, caplog: pytest.LogCaptureFixture):
    seen = [{"late": 2, "stray": 0}, {"late": 0, "stray": 0}, {}, {"late": 0, "stray": 1}]

    def drive(part: ChunkPart) -> list[EpisodeResult]:
        each = zip(part.chunk.requests, seen, strict=True)
        return [passed(request.index).model_copy(update=kept) for request, kept in each]

    batch = begun(file_store)
    first, *_, last = (request.index for request in batch.layout.chunk(0).requests)
    run_chunk(batch, 0, drive, lanes=4, left_s=3600.0)
    assert caplog.messages == [f"chunk 0: lock-step did not hold in 2 of 4 jobs ({first}, {last})"]


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
        told = (np.ones(lanes, int), none == 1, one[:, 0], one[:, 0], one[:, 0], none, one[:, :, :2], lidars)
        done = Ends(*told, *[one[:, :0, :2]] * 6)
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
    run_chunk(batch, 0, recorded.simulate, recorded.write, lanes=2, left_s=3600.0)
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

    run_chunk(batch, 0, simulate, Recorded().write, lanes=4, left_s=3600.0)
    assert said == [RecordingChoice(always=always, failed=episodes == "failed")]


def test_the_parts_of_a_chunk_share_the_memory_for_samples(file_store: Store):
    batch, recorded = begun(file_store), Recorded()
    held: list[object] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        assert part.recorder
        held.append(part.recorder._overflow)
        return recorded.simulate(part)

    run_chunk(batch, 0, simulate, recorded.write, lanes=2, left_s=3600.0)
    assert len(held) == 2
    assert held[0] is held[1]


def test_a_recording_is_written_before_the_chunk_that_names_it(file_store: Store):
    batch, recorded = begun(file_store), Recorded()

    def dies(number: int, parts: Iterable[Columns]) -> str:
        assert committed_chunk(file_store, batch.id, number) is None
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_chunk(batch, 0, recorded.simulate, dies, lanes=4, left_s=3600.0)
    assert committed_chunk(file_store, batch.id, 0) is None


def test_a_cancelled_job_leaves_no_recording(file_store: Store):
    batch, recorded = begun(file_store), Recorded()
    cancel_job(file_store, f"{batch.id}/1")

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        part.watch()
        return recorded.simulate(part)

    run_chunk(batch, 0, simulate, recorded.write, lanes=4, left_s=3600.0)
    assert recorded.written == {0: [3]}


def test_who_is_cancelled_while_recordings_are_written_is_canceled_and_leaves_none(file_store: Store):
    batch, recorded = begun(file_store), Recorded()

    def slow(number: int, parts: Iterable[Columns]) -> str:
        name = recorded.write(number, parts)
        if recorded.written[number] == [1, 3]:
            for index in (0, 1):
                cancel_job(file_store, f"{batch.id}/{index}")
        return name

    run_chunk(batch, 0, recorded.simulate, slow, lanes=4, left_s=3600.0)
    rows = committed_chunk(file_store, batch.id, 0) or []
    assert [row.status for row in rows[:3]] == ["Canceled", "Canceled", "Completed"]
    assert recorded.written == {0: [3]}
    assert [row.recording for row in rows] == ["", "", "", "0.parquet"]


@pytest.fixture
def tagged(file_store: Store) -> OpenBatch:
    return begun(file_store, plan(file_store, seeds=(1, 2)))


def tags(tagged: OpenBatch, index: int) -> dict[str, str]:
    return tags_of(tagged.store, Reference(kind="simulation-job", path=f"{tagged.id}/{index}"), {})


def test_tags_of_an_application_are_its_jobs(tagged: OpenBatch):
    tag_jobs(tagged, {1: {"found": "a wall"}})
    tag_jobs(tagged, {1: {"found": "a door", "seen": "much"}})
    assert (tags(tagged, 0), tags(tagged, 1)) == ({}, {"found": "a door", "seen": "much"})


def test_tags_that_a_job_cannot_have_are_told_to_the_log_and_end_nothing(
    tagged: OpenBatch, caplog: pytest.LogCaptureFixture
):
    tag_jobs(tagged, {0: {"simyard:outcome": "Passed"}, 1: {"sound": "yes"}})
    assert (tags(tagged, 0), tags(tagged, 1)) == ({}, {"sound": "yes"})
    assert "tags of its application" in caplog.text


def test_a_job_that_its_application_cancels_says_so(tagged: OpenBatch):
    def withdrawn(part: ChunkPart) -> list[EpisodeResult]:
        first, *rest = all_pass(part)
        canceled = unfinished_result(first.index, "Canceled", failure_code="", failure_reason=WITHDRAWN)
        return [canceled, *rest]

    run_chunk(tagged, 0, withdrawn, lanes=4, left_s=3600.0)
    rows = committed_chunk(tagged.store, tagged.id, 0)
    assert rows is not None
    assert (rows[0].status, rows[0].failure_code, rows[0].failure_reason) == ("Canceled", "", WITHDRAWN)


FAULTS = [
    StoreAway("the store does not answer"),
    OSError(errno.ENOSPC, "no space left on device"),
    BundleRefused("the archive holds a link"),
]
Break = Callable[[int, Exception], None]


@pytest.fixture
def batch(file_store: Store) -> OpenBatch:
    """Returns a batch of three chunks."""
    return begun(file_store, plan(file_store, seeds=tuple(range(6))))


@pytest.fixture
def break_chunk(monkeypatch: pytest.MonkeyPatch) -> Break:
    """Lets the making ready of a chunk fail."""

    def broken(number: int, error: Exception) -> None:
        def prepared(batch: OpenBatch, asked: int, unusable: Mapping[str, Failure]) -> PreparedChunk:
            if asked == number:
                raise error
            return prepared_chunk(batch, asked, unusable)

        monkeypatch.setattr(chunk_run, "prepared_chunk", prepared)

    return broken


@pytest.mark.parametrize("error", FAULTS)
def test_a_chunk_that_cannot_be_made_ready_yet_is_told_to_the_log_and_fails_no_other(
    batch: OpenBatch, break_chunk: Break, error: Exception, caplog: pytest.LogCaptureFixture
):
    break_chunk(1, error)
    assert coming_chunks(batch, (1, 2), {})() == []
    (said,) = caplog.records
    assert (said.levelname, said.message) == ("WARNING", f"chunk 1 does not begin early: {error}")


def test_the_chunks_before_one_that_cannot_be_made_ready_begin_early(batch: OpenBatch, break_chunk: Break):
    break_chunk(2, FAULTS[0])
    assert [each.asked.number for each in coming_chunks(batch, (1, 2), {})()] == [1]


def test_a_defect_is_not_only_told_to_the_log(batch: OpenBatch, break_chunk: Break):
    break_chunk(1, TypeError("a defect"))
    with pytest.raises(TypeError, match="a defect"):
        coming_chunks(batch, (1, 2), {})()


def test_a_chunk_that_was_made_ready_early_is_the_same_when_it_is_its_turn(batch: OpenBatch):
    (early,) = coming_chunks(batch, (1,), {})()
    assert prepared_chunk(batch, 1, {}).able.requests is early.able.requests


def test_a_chunk_whose_application_cannot_be_used_any_more_is_made_ready_anew(batch: OpenBatch):
    (early,) = coming_chunks(batch, (1,), {})()
    failure = Failure("RobotApplicationCrash", "it is gone")
    found = prepared_chunk(batch, 1, {early.asked.requests[0].robot.digest: failure})
    assert set(found.unable.values()) == {failure}


def test_of_chunks_that_were_made_ready_early_a_few_are_kept(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(chunk_run, "_EARLY", 1)
    first, second = (prepared_chunk(batch, number, {}) for number in (1, 2))
    assert prepared_chunk(batch, 2, {}) is second
    again = prepared_chunk(batch, 1, {})
    assert again == first
    assert again is not first


def test_chunks_that_were_made_ready_early_are_forgotten_at_their_batchs_end(batch: OpenBatch, file_store: Store):
    other = begun(file_store, plan(file_store, seeds=(7, 8, 9)), "another")
    ours, theirs = (prepared_chunk(each, 1, {}) for each in (batch, other))
    forget_chunks(batch)
    assert prepared_chunk(other, 1, {}) is theirs
    assert prepared_chunk(batch, 1, {}) is not ours


def test_chunks_of_two_batches_that_have_one_number_are_told_apart(batch: OpenBatch, file_store: Store):
    other = begun(file_store, plan(file_store, seeds=(7, 8, 9)), "another")
    for each in (batch, other):
        assert prepared_chunk(each, 0, {}).asked == each.layout.chunk(0)


def test_a_chunk_that_reads_data_is_made_ready_when_it_is_its_turn(file_store: Store):
    source = PinnedSource(name="routes", bucket="routes", type="File", destination="data")
    batch = begun(file_store, plan(file_store, data_sources={source.digest: source}))
    (early,) = coming_chunks(batch, (1,), {})()
    assert prepared_chunk(batch, 1, {}) is not early
