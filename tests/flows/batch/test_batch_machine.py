"""A batch under everything that may happen to it in any order: what was true of a job's end stays true.

People cancel and restart, time runs out, processes die, others go on, somebody asks. Whatever the order, a chunk is
committed once, a batch that has ended stays as it ended, and every job has one of RoboMaker's states at all times.
"""

import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from flows.batch.batch_end import close_if_stopped, close_with_tables
from specs.data.episode import EpisodeResult, unfinished_result
from specs.errors import DocumentError, ResourceNotFound
from tasks.simulate.batch.batch_jobs import Jobs, cancel_batch, cancel_job, describe_batch, describe_job, restart_job
from tasks.simulate.batch.batch_record import GOING, STOPPING, OpenBatch, complete, time_out
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.batch.result_stream import result_parts
from tasks.storage.jobs.records import is_terminal
from tasks.storage.store_url import open_store
from tests.factories.episodes import crashed, passed
from tests.factories.planned_batches import begun, plan, template

pytestmark = pytest.mark.long

JOBS, LANES = 12, 4
CHUNKS = JOBS // LANES
TERMINAL = {"Completed", "Failed", "Canceled"}
STATES = {
    "InProgress": {"Pending", "Running", "Restarting", "RunningFailed", "Terminating", *TERMINAL},
    "Canceling": {"Pending", "RunningFailed", "Terminating", *TERMINAL},
    "TimingOut": {"Pending", "RunningFailed", "Terminating", *TERMINAL},
    "Completing": {"RunningFailed", *TERMINAL},
}
jobs = st.integers(0, JOBS - 1)


class Died(BaseException):
    """What a process would not outlive."""


class Batches(RuleBasedStateMachine):
    """One batch, and all that may happen to it."""

    batch: OpenBatch

    @initialize()
    def open(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="simyard-machine-"))
        store = open_store((self.folder / "store").as_uri())
        entries = (template(), template(failure_behavior="Continue"))
        self.batch = begun(store, plan(store, templates=entries, lanes=LANES))
        self.rows: dict[int, list[EpisodeResult]] = {}
        self.ended: dict[str, object] = {}
        self.ends: dict[int, str | None] = {}

    def teardown(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    @rule(job=jobs)
    def cancel_a_job(self, job: int) -> None:
        self._allowed(lambda: cancel_job(self.batch.store, f"{self.batch.id}/{job}"))

    @rule(job=jobs)
    def restart_a_job(self, job: int) -> None:
        self._allowed(lambda: restart_job(self.batch.store, f"{self.batch.id}/{job}"))

    @rule()
    def cancel_it(self) -> None:
        self._allowed(lambda: cancel_batch(self.batch.store, self.batch.id))

    @rule()
    def run_out_of_time(self) -> None:
        time_out(self.batch)

    @rule()
    def ask(self) -> None:
        record = close_if_stopped(self.batch.store, self.batch.id)
        assert record.status not in STOPPING

    @rule(
        number=st.integers(0, CHUNKS - 1),
        fate=st.sampled_from(["well", "well", "crash", "death", "late", "cancel", "cancel job", "restart"]),
        position=st.integers(0, LANES - 1),
    )
    def work_on_a_chunk(self, number: int, fate: str, position: int) -> None:
        if self.batch.record().status not in GOING:
            return
        happened: list[str] = []

        def simulate(part: ChunkPart) -> list[EpisodeResult]:
            assert number not in self.rows, "a committed chunk was simulated again"
            job = part.chunk.requests[position % len(part.chunk.requests)].index
            if not happened:
                happened.append(fate)
                self._befall(fate, job)
            part.watch._next_look_s = 0.0  # as if a second had passed
            part.watch()
            return [self._row(each.index, fate, job, part.watch.code) for each in part.chunk.requests]

        try:
            run_chunk(self.batch, number, simulate, lanes=LANES, left_s=-1.0 if fate == "late" else 3600.0)
        except Died:
            return

    @rule()
    @precondition(lambda self: all(committed_chunk(self.batch.store, self.batch.id, k) for k in range(CHUNKS)))
    def close_it(self) -> None:
        if not is_terminal(complete(self.batch)):
            close_with_tables(self.batch)

    @invariant()
    def committed_rows_stay(self) -> None:
        for number in range(CHUNKS):
            rows = committed_chunk(self.batch.store, self.batch.id, number)
            assert self.rows.get(number, rows) == rows
            if rows is not None:
                self.rows[number] = rows
                assert [row.index for row in rows] == list(range(number * LANES, (number + 1) * LANES))

    @invariant()
    def an_ended_batch_stays_ended(self) -> None:
        if is_terminal(self.batch.record()):
            answer = describe_batch(self.batch.store, self.batch.id).model_dump()
            assert self.ended in ({}, answer)
            self.ended = answer
            assert [
                row.index for _, rows in result_parts(self.batch, self.batch.record().status) for row in rows
            ] == list(range(JOBS))

    @invariant()
    def every_job_is_somewhere(self) -> None:
        counts = Jobs(self.batch.store, self.batch.id).counts()
        assert counts.pending + counts.created + counts.failed == JOBS
        status = self.batch.record().status
        for index in range(JOBS):
            try:
                job = describe_job(self.batch.store, f"{self.batch.id}/{index}")
            except ResourceNotFound:  # the batch ended before this request became a job
                assert status in {"Canceled", "TimedOut"}
                assert index not in self.rows_by_index()
                continue
            assert job.status in STATES.get(status, TERMINAL), status
            assert self.ends.setdefault(index, job.status) == job.status
            if job.status not in TERMINAL:
                del self.ends[index]

    def rows_by_index(self) -> set[int]:
        """Returns the indices of the jobs that have a row."""
        return {row.index for rows in self.rows.values() for row in rows}

    def _befall(self, fate: str, job: int) -> None:
        if fate == "death":
            raise Died
        if fate == "cancel":
            self._allowed(lambda: cancel_batch(self.batch.store, self.batch.id))
        if fate == "cancel job":
            self._allowed(lambda: cancel_job(self.batch.store, f"{self.batch.id}/{job}"))
        if fate == "restart":
            self._allowed(lambda: restart_job(self.batch.store, f"{self.batch.id}/{job}"))

    @staticmethod
    def _row(index: int, fate: str, job: int, code: str) -> EpisodeResult:
        if code:
            return unfinished_result(index, "Canceled", failure_code="", failure_reason="stopped before its end")
        return crashed(index) if fate == "crash" and index == job else passed(index)

    @staticmethod
    def _allowed(act: Callable[[], object]) -> None:
        """Does what may come too late."""
        with suppress(DocumentError):
            act()


Batches.TestCase.settings = settings(max_examples=30, stateful_step_count=20, deadline=None)
TestBatches = Batches.TestCase
