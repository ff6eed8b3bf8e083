"""The job record of a batch: opened once, moved from state to state, closed when all chunks are committed.

See docs/reference/robomaker.md, section 4.

    Pending -> InProgress -> Completing -> Completed | Failed
               InProgress -> Canceling -> Canceled        somebody cancelled it
               InProgress -> TimingOut -> TimedOut        its wall time is over

A chunk is committed by creating one immutable object. Killed anywhere, a batch goes on with the chunks that are
missing, and since a chunk's results depend on the plan alone, an unbroken run would have written the same bytes.

A watch tells a chunk to stop when the record says so. It is asked between slices, and asks the store once a second.
Episodes that never ran are Canceled, as RoboMaker calls such jobs.
"""

import functools
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, cast, get_args

from pydantic import JsonValue

from specs.data.episode import WITHDRAWN, EpisodeResult, unfinished_result
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from specs.robomaker.simulation import SimulationJobBatchErrorCode, SimulationJobErrorCode
from tasks.simulate.batch.chunk_store import commit
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator, owner_authenticator
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.store_url import open_store

KIND = "simulation-job-batch"
STOPPING = frozenset({"Canceling", "TimingOut"})
GOING = frozenset({"Pending", "InProgress"})
_LAYOUTS_KEPT = 4
_JOB_CODE = "jobFailureCode"
_ETAGS = "dataSourceEtags"
_CANCELED_JOB = "canceledJob/"
_CANCELED_JOB_AT = "canceledJobAt/"
_RESTARTED_JOB = "restartedJob/"


@dataclass(frozen=True)
class OpenBatch:
    """A batch that is being worked on.

    Attributes:
        store: Where its record, worlds and chunks are.
        id: Its id.
        layout: Its episodes and chunks.
        given: What vouches for its chunks, for a worker that was given it; None on a machine of the owner.
    """

    store: Store
    id: str
    layout: Layout
    given: BatchAuthenticator | None = None

    @property
    def plan(self) -> BatchPlan:
        """Returns what it runs."""
        return self.layout.plan

    @functools.cached_property
    def authenticator(self) -> BatchAuthenticator:
        """What vouches for its chunks, as those of the plan that this process knows."""
        return self.given or owner_authenticator(self.id, self.layout.plan_digest)

    def record(self) -> JobRecord:
        """Returns its record as it stands now."""
        return read(self.store, KIND, self.id)


def open_batch(store: Store, plan: BatchPlan, request: dict[str, JsonValue], token: str) -> JobRecord:
    """Returns the batch of the token, in progress unless it is being stopped or has ended.

    Args:
        store: Where the record is kept.
        plan: What the batch runs.
        request: The StartSimulationJobBatch document.
        token: The client request token.

    Raises:
        IdempotentParameterMismatch: The token came with another batch before.
    """
    record = submit(store, KIND, {"request": request, "plan": plan.model_dump(mode="json")}, token)
    return advance(store, KIND, record.id, "InProgress", only_from={"Pending"}, detail=etag_detail(plan))


def load_batch(store: Store, batch: str, authenticator: BatchAuthenticator | None = None) -> OpenBatch:
    """Returns a batch that was opened before.

    Args:
        store: Where its record is.
        batch: Its id.
        authenticator: What a worker was given to vouch for its chunks; None on a machine of the owner.

    Raises:
        ResourceNotFound: No such batch.
        StageFailed: Its record says another plan than the one that the worker shall vouch for.
    """
    found = OpenBatch(store, batch, _layout(store.url, batch), authenticator)
    if authenticator and authenticator.plan != found.layout.plan_digest:
        raise _another_plan(store, batch, found.layout.plan_digest, authenticator.plan)
    return found


def require_plan(store: Store, batch: str, plan: BatchPlan) -> OpenBatch:
    """Returns a batch that was opened with a plan, if its record says that plan.

    Raises:
        ResourceNotFound: No such batch.
        StageFailed: It says another one.
    """
    found, meant = load_batch(store, batch), Layout(plan)
    if found.layout.plan_digest != meant.plan_digest:
        raise _another_plan(store, batch, found.layout.plan_digest, meant.plan_digest)
    return found


def _another_plan(store: Store, batch: str, found: str, meant: str) -> StageFailed:
    why = f"{store.url}/{job_key(KIND, batch)} says the plan {found}; the document's plan is {meant}"
    return StageFailed("MismatchedEtag", f"{why}. Somebody has changed the record: run the document again")


def plan_of(record: JobRecord) -> BatchPlan:
    """Returns the plan that a batch was opened with."""
    return BatchPlan.model_validate(record.request["plan"])


def time_out(batch: OpenBatch) -> JobRecord:
    """Returns the record of a batch that begins no more episodes, because its wall time is over."""
    return advance(batch.store, KIND, batch.id, "TimingOut", only_from={"InProgress"})


def complete(batch: OpenBatch) -> JobRecord:
    """Returns the record of a batch whose episodes all have their end, one way or another; only tables are missing."""
    return advance(batch.store, KIND, batch.id, "Completing", only_from={"InProgress"})


def terminal_state(record: JobRecord, failed_inside: int) -> tuple[str, str]:
    """Returns the terminal state that a batch goes to, and why (docs/reference/robomaker.md, section 4).

    Args:
        record: As it stood when its last episode ended.
        failed_inside: How many jobs failed with InternalServiceError: others that Failed do not fail the batch.
    """
    if record.status == "Canceling":  # which leads nowhere else, whatever went wrong before
        return "Canceled", "canceled on request"
    if failed_inside:
        return "Failed", f"{failed_inside} jobs could not be simulated; their rows say why"
    if record.status == "TimingOut":
        return "TimedOut", f"the batch's {plan_of(record).timeout_s:.0f} s were over"
    return "Completed", ""


def job_of(store: Store, path: str) -> tuple[OpenBatch, int]:
    """Returns the batch and the index of the job ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such batch, or it has no such job.
    """
    name, _, number = path.partition("/")
    batch = load_batch(store, name)
    jobs = batch.layout.episodes
    index = int(number) if number.isdecimal() else -1
    if not 0 <= index < jobs or number != str(index):
        allowed = f"{name}/0 to {name}/{jobs - 1}"
        raise ResourceNotFound.of("simulation-job", repr(path), allowed)
    return batch, index


def canceled_job_mark(index: int) -> str:
    """Returns the key in a batch's detail that says that a job was cancelled by itself, and whether it had begun."""
    return f"{_CANCELED_JOB}{index}"


def canceled_jobs(record: JobRecord) -> frozenset[int]:
    """Returns the indices of the jobs that were cancelled by themselves."""
    return frozenset(int(key.removeprefix(_CANCELED_JOB)) for key in record.detail if key.startswith(_CANCELED_JOB))


def canceled_before_begun(record: JobRecord) -> frozenset[int]:
    """Returns the indices of the jobs that were cancelled by themselves before their chunk was begun."""
    return frozenset(index for index in canceled_jobs(record) if record.detail[canceled_job_mark(index)] is False)


def canceled_job_time(index: int) -> str:
    """Returns the key in a batch's detail that says when a job was cancelled by itself, in seconds since 1970."""
    return f"{_CANCELED_JOB_AT}{index}"


def canceled_job_times(record: JobRecord) -> dict[int, float]:
    """Returns when jobs were cancelled by themselves, by index; records of older versions do not say."""
    return _times(record, _CANCELED_JOB_AT)


def restarted_job_mark(index: int) -> str:
    """Returns the key in a batch's detail that says when a job was last restarted, in seconds since 1970."""
    return f"{_RESTARTED_JOB}{index}"


def restarted_jobs(record: JobRecord) -> dict[int, float]:
    """Returns when jobs were last restarted, by index."""
    return _times(record, _RESTARTED_JOB)


def _times(record: JobRecord, mark: str) -> dict[int, float]:
    return {
        int(key.removeprefix(mark)): cast("float", at_s) for key, at_s in record.detail.items() if key.startswith(mark)
    }


def etag_detail(plan: BatchPlan) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its data sources' files: the ETag of each, by ``<bucket>/<key>``.

    The plan does not say them: it pins contents, and the same content is the same plan whoever uploaded it.
    """
    sources = plan.data_sources.values()
    etags: dict[str, JsonValue] = {
        f"{source.bucket}/{file.key}": file.etag for source in sources for file in source.files if file.etag
    }
    return {_ETAGS: etags} if etags else {}


def etags_of(record: JobRecord) -> dict[str, str]:
    """Returns the ETags that `etag_detail` noted; records of older versions have none."""
    return cast("dict[str, str]", record.detail.get(_ETAGS, {}))


def close_batch(
    store: Store, batch: str, status: str, detail: Mapping[str, JsonValue], failure_reason: str = ""
) -> JobRecord:
    """Returns the batch's record in its terminal state: jobs that Failed do not fail the batch.

    See docs/reference/robomaker.md, section 4.

    Args:
        store: Where its record is.
        batch: Its id.
        status: The terminal state.
        detail: What is added to its record's detail.
        failure_reason: Why it Failed, for a person, or empty.
    """
    code: SimulationJobBatchErrorCode | Literal[""] = "InternalServiceError" if status == "Failed" else ""
    return advance(store, KIND, batch, status, failure_code=code, failure_reason=failure_reason, detail=dict(detail))


def close_refused(batch: OpenBatch, error: DocumentError | StageFailed) -> JobRecord:
    """Returns the record of a batch that nobody can continue: Failed, or Canceled if it was being cancelled.

    Its jobs that have no row, and those whose output is refused, say the same code as the error.
    """
    status = "Canceled" if batch.record().status == "Canceling" else "Failed"
    return close_batch(batch.store, batch.id, status, lost_job_detail(error), str(error))


def lost_job_detail(cause: Exception | str) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its jobs that do not come to their end, by what ended the batch."""
    if isinstance(cause, DocumentError):
        return {_JOB_CODE: "InvalidInput"}
    code = job_code(cause.code) if isinstance(cause, StageFailed) else None
    return {_JOB_CODE: code} if code else {}


def lost_job_code(record: JobRecord) -> SimulationJobErrorCode:
    """Returns the failure code of a Failed batch's jobs that did not come to their end."""
    return job_code(str(record.detail.get(_JOB_CODE, ""))) or "InternalServiceError"


def job_code(text: str) -> SimulationJobErrorCode | None:
    """Returns text that is a failure code of simulation jobs; None for any other."""
    return next((code for code in get_args(SimulationJobErrorCode) if code == text), None)


@functools.lru_cache(maxsize=_LAYOUTS_KEPT)
def _layout(store_url: str, batch: str) -> Layout:
    """Returns a batch's layout; kept, because a plan never changes and a large one takes a while to read."""
    return Layout(plan_of(read(open_store(store_url), KIND, batch)))


StopCode = Literal["", "BatchTimedOut", "BatchCanceled"]
STOP_CODES: Mapping[str, StopCode] = {
    "Canceling": "BatchCanceled",
    "Canceled": "BatchCanceled",
    "TimingOut": "BatchTimedOut",
    "TimedOut": "BatchTimedOut",
}
"""Why the episodes of a batch in such a state are Canceled."""
_POLL_S = 1.0
LEFT_OUT = "the batch was ended before it began: the gate was certain"


class StopWatch:
    """Whether the work on a chunk shall end.

    Attributes:
        code: Why it shall, as RoboMaker's failure code; empty as long as it shall not.
        canceled: The jobs that were cancelled by themselves, as last seen.
    """

    def __init__(
        self, batch: OpenBatch, jobs: Collection[int], left_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begins to watch.

        Args:
            batch: Whose record is looked at.
            jobs: Indices of the chunk's jobs; when all of them are cancelled, nothing is left to do.
            left_s: Wall seconds that the batch has left.
            clock: Seconds that never go back.
        """
        self.code: StopCode = ""
        self.canceled: frozenset[int] = frozenset()
        self._batch = batch
        self._jobs = frozenset(jobs)
        self._clock = clock
        self._deadline_s = clock() + left_s
        self._next_look_s = clock()

    def __call__(self) -> bool:
        """Returns whether the work shall end now."""
        now_s = self._clock()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + _POLL_S
            self.look(self._batch.record())
        if not self.code and now_s >= self._deadline_s:
            self.code = "BatchTimedOut"
        return bool(self.code) or self._jobs <= self.canceled

    def look(self, record: JobRecord) -> None:
        """Notes what the batch's record says now; for who has read it anyway, or must not wait for the next look."""
        self.canceled = canceled_jobs(record)
        if record.status == "Canceling":
            self.code = "BatchCanceled"
        elif record.status == "TimingOut":  # as whoever hands out chunks to many workers finds first
            self.code = "BatchTimedOut"

    def settled(self, row: EpisodeResult) -> EpisodeResult:
        """Returns a row as it stands after what was cancelled: the batch, or this job alone."""
        if row.index in self.canceled:
            return unfinished_result(row.index, "Canceled", failure_code="", failure_reason="the job was canceled")
        if row.status == "Canceled" and row.failure_reason != WITHDRAWN:
            return canceled_row(row.index, self.code)
        return row


def canceled_row(index: int, code: StopCode) -> EpisodeResult:
    """Returns the row of an episode that was not ended because its batch was: BatchTimedOut or BatchCanceled."""
    why = "the batch was canceled" if code == "BatchCanceled" else "the batch's time was over"
    return unfinished_result(index, "Canceled", failure_code=code, failure_reason=why)


def leave_out(batch: OpenBatch, first: int) -> int:
    """Commits all chunks from the one with that number on with Canceled episodes; returns how many those are.

    Doing it again changes nothing, so that a process that dies over it is simply followed by another.
    """
    left_out = 0
    for number in range(first, batch.layout.chunks):
        indices = [request.index for request in batch.layout.chunk(number).requests]
        rows = [unfinished_result(index, "Canceled", failure_code="", failure_reason=LEFT_OUT) for index in indices]
        commit(batch.store, batch.id, number, rows, batch.authenticator)
        left_out += len(rows)
    return left_out


def was_left_out(rows: Sequence[EpisodeResult]) -> bool:
    """Returns whether a chunk's rows are those of one that was left out."""
    return bool(rows) and rows[0].failure_reason == LEFT_OUT
