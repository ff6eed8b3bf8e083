"""A worker's attempts at the jobs of the queue: one worker at a job, and no job for ever.

A queued job that cannot be done ends Failed, with a code that RoboMaker has for its kind, and the reason.
"""

import logging
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pydantic import JsonValue

from flows.resources.kinds import KINDS
from specs.errors import (
    BundleRefused,
    DocumentError,
    ResourceNotFound,
    SimyardError,
    StageFailed,
    StoreAway,
    StoreError,
    TrustRefused,
    WorldChanged,
)
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import JobFailureCode
from tasks.deploy.rollout.operator_commands import close_abandoned_job
from tasks.simulate.batch.batch_record import lost_job_detail
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, ClaimWatch, hold_claim_unless_alive
from tasks.storage.jobs.queue import QueueEntry, change_entry, find_entry, leave_queue, turn_key
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read

# What a description of the job's kind reads, whatever came of the job.
_NOTHING_MADE: Mapping[JobKind, dict[str, JsonValue]] = {
    "world-generation-job": {"worlds": [], "failures": {}},
}
# Enough for somebody who kills workers for another reason than the job.
MOST_ATTEMPTS = 10
# Whoever queued it died before the record; a client that repeats its request makes both.
_WITHOUT_RECORD_S = 60.0
# A roll-out works in bursts and waits between them: one that ran so long did not kill its worker.
_LASTED_S = 300.0
_LONGEST_PAUSE_S = 60.0
_PATIENCE = 2
_REFUSED = (DocumentError, TrustRefused, BundleRefused, WorldChanged, StageFailed)
logger = logging.getLogger(__name__)


class _Codes(NamedTuple):
    """The codes of a kind: what it refers to is missing, it can never be done, and it is Simyard that cannot."""

    missing: JobFailureCode
    refused: JobFailureCode
    inside: JobFailureCode


# Describe answers only the codes of the job's own kind.
CODES: Mapping[JobKind, _Codes] = {
    "world-generation-job": _Codes("ResourceNotFound", "InvalidInput", "InternalServiceError"),
    "world-export-job": _Codes("ResourceNotFound", "InvalidInput", "InternalServiceError"),
    "simulation-job-batch": _Codes("InternalServiceError", "InternalServiceError", "InternalServiceError"),
    "deployment-job": _Codes("ResourceNotFound", "InternalServerError", "InternalServerError"),
    "pipeline-run": _Codes("InvalidInput", "InvalidInput", "Failed"),
}


def fail_job(store: Store, record: JobRecord, cause: Exception | str) -> JobRecord:
    """Returns the job's record, Failed, or Canceled if somebody cancels it; as it stands if somebody works on it.

    Args:
        store: Where it is.
        record: The job's.
        cause: Why it cannot be done.
    """
    with hold_claim_unless_alive(store, claim_key(record.kind, record.id)) as claim:
        if claim is None:
            return read(store, record.kind, record.id)
        return _end(store, read(store, record.kind, record.id), claim, cause)


def _end(store: Store, record: JobRecord, claim: Claim, cause: Exception | str) -> JobRecord:
    reason = str(cause)
    if is_terminal(record):
        return record
    if record.kind == "deployment-job":  # robots that it has announced are asked no more
        return close_abandoned_job(store, record, claim, reason, failure_code=_code(record.kind, cause))
    detail = {name: value for name, value in _NOTHING_MADE.get(record.kind, {}).items() if name not in record.detail}
    if record.status == "Canceling":
        return advance(store, record.kind, record.id, "Canceled", failure_reason=reason, detail=detail)
    code = _code(record.kind, cause)
    if record.kind == "simulation-job-batch":
        detail |= lost_job_detail(cause)
    return advance(store, record.kind, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def _code(kind: JobKind, cause: Exception | str) -> JobFailureCode:
    codes = CODES[kind]
    if isinstance(cause, ResourceNotFound):
        return codes.missing
    return codes.refused if isinstance(cause, DocumentError) else codes.inside


# A worker holds a claim of its own on a job (`tasks.storage.jobs.queue.turn_key`), so that the others pass it by
# without waiting, and take over when the worker is dead. Each attempt is counted in the job's entry before it begins:
# a job that kills its worker is known by that. An attempt of which something came, a chunk or a world or a robot, is
# forgotten. A store or a Prefect server that is away is waited for, however long.
class ServerAway(Exception):  # noqa: N818 - a state
    """Prefect's server does not answer; no job is at fault."""


class Job(NamedTuple):
    """A queued job at its turn: its record as it stands, and its entry, in which this attempt is counted."""

    record: JobRecord
    entry: QueueEntry


Work = Callable[[Job], object]


class Attempts:
    """What one worker knows of the jobs of a queue; several threads may ask at once.

    Args:
        store: Where the queue is.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._watches: dict[str, list[ClaimWatch]] = {}
        self._begun: dict[str, QueueEntry] = {}

    def attempt(self, entry: QueueEntry, work: Work) -> bool:
        """Returns whether this worker had the job's turn; False at once if another one has, or it is too early.

        Args:
            entry: The job's.
            work: Ends the job; raises what it cannot explain away.
        """
        try:
            return entry.not_before_s <= time.time() and self._attempt(entry, work)
        except StoreAway:
            raise
        except StoreError as exc:  # of this job alone: the others shall not wait for it
            self._put_off(entry, exc)
            return False
        except Exception as exc:  # a record that nobody foresaw, such as a stranger's, shall not end the worker
            logger.exception("%s met a defect of Simyard", entry.id)
            self._put_off(entry, exc)
            return False

    def _attempt(self, entry: QueueEntry, work: Work) -> bool:
        if not self._has_record(entry) or not self._is_free(entry):
            return False
        with hold_claim_unless_alive(self._store, turn_key(entry.kind, entry.id)) as claim:
            if claim is None:
                return False
            ended = self._take(entry, work)
        self._watches.pop(entry.id, None)
        if ended:
            self._store.delete(turn_key(entry.kind, entry.id))
        return True

    def drop_if_done(self, entry: QueueEntry) -> bool:
        """Returns whether nothing is to be done for an entry, now or ever; one of a job that has ended is removed."""
        if not self._has_record(entry):
            return True
        if not is_terminal(read(self._store, entry.kind, entry.id)):
            return False
        if self._is_free(entry):
            leave_queue(self._store, entry.kind, entry.id)
        return True

    def give_back(self) -> None:
        """Uncounts the attempts that are under way: this process is about to end, by no fault of theirs."""
        for entry in list(self._begun.values()):
            self._uncount(entry)

    def _has_record(self, entry: QueueEntry) -> bool:
        try:
            read(self._store, entry.kind, entry.id)
        except ResourceNotFound:
            if time.time() - entry.queued_at_s > _WITHOUT_RECORD_S:
                logger.warning("%s was queued and never recorded; it leaves the queue", entry.id)
                leave_queue(self._store, entry.kind, entry.id)
            return False
        return True

    def _is_free(self, entry: QueueEntry) -> bool:
        """Returns whether nobody alive works on the job, as far as can be told without waiting.

        It may be a worker, or a `simyard run` whose job somebody has queued to be ended.
        """
        if entry.id not in self._watches:
            keys = turn_key(entry.kind, entry.id), claim_key(entry.kind, entry.id)
            self._watches[entry.id] = [ClaimWatch(self._store, key) for key in keys]
        left = [watch.is_left() for watch in self._watches[entry.id]]  # each, each time: so they see a heartbeat
        return all(left) and self._watches[entry.id][0].release()

    def _take(self, seen: QueueEntry, work: Work) -> bool:
        """Returns whether the job has left the queue."""
        entry, record = find_entry(self._store, seen.kind, seen.id), read(self._store, seen.kind, seen.id)
        # One that has ended and was begun may lack what comes after the end, such as the picture of its worlds.
        begun = self._begin(entry, record) if entry and (entry.attempts or not is_terminal(record)) else None
        if begun and begun.attempts > MOST_ATTEMPTS:
            tried = f"{MOST_ATTEMPTS} attempts have ended without a result, the last by the death of its worker"
            self._fail(begun, record, f"{tried}; the worker's log says more")
        elif begun:
            self._try(Job(record, begun), work)
        if not is_terminal(read(self._store, seen.kind, seen.id)):
            return False
        leave_queue(self._store, seen.kind, seen.id)
        return True

    def _begin(self, entry: QueueEntry, record: JobRecord) -> QueueEntry | None:
        now_s = time.time()
        if not entry.attempts:
            return change_entry(self._store, entry.kind, entry.id, attempts=1, begun_s=now_s)
        done = self._done(record)
        lasted = record.kind == "deployment-job" and now_s - entry.begun_s > _LASTED_S
        attempts = 1 if lasted or -1 < entry.done < done else entry.attempts + 1
        # For the worker after this one, if this one dies, too: others shall have their turn.
        pause_s = _pause_s(attempts) if attempts > _PATIENCE else 0.0
        fields = {"attempts": attempts, "done": done, "begun_s": now_s, "not_before_s": now_s + pause_s}
        return change_entry(self._store, entry.kind, entry.id, **fields)

    def _done(self, record: JobRecord) -> int:
        look = KINDS[record.kind].load().progress
        try:
            return look(self._store, record)[1] if look else 0
        except StoreAway:
            raise
        except (SimyardError, ValueError, LookupError) as exc:  # the record is not what its stage reads
            logger.warning("how far %s is could not be seen: %s", record.arn, exc)
            return 0

    def _try(self, job: Job, work: Work) -> None:
        self._begun[job.entry.id] = job.entry
        try:
            work(job)
        except _REFUSED as exc:
            self._fail(job.entry, job.record, exc)
        except (StoreAway, ServerAway) as exc:
            self._uncount(job.entry)
            self._put_off(job.entry, exc)
        except SimyardError as exc:
            self._fail_or_put_off(job, exc)
        except Exception as exc:
            logger.exception("%s met a defect of Simyard", job.record.arn)
            self._fail_or_put_off(job, exc)
        except BaseException:  # this process is being ended
            self._uncount(job.entry)
            raise
        finally:
            self._begun.pop(job.entry.id, None)

    def _fail_or_put_off(self, job: Job, exc: Exception) -> None:
        if job.entry.attempts >= MOST_ATTEMPTS:
            self._fail(job.entry, job.record, exc)
        else:
            self._put_off(job.entry, exc)

    def _put_off(self, entry: QueueEntry, exc: Exception) -> None:
        pause_s = _pause_s(max(1, entry.attempts))
        logger.warning("%s is tried again in %.0f s: %s", entry.id, pause_s, exc)
        change_entry(self._store, entry.kind, entry.id, not_before_s=time.time() + pause_s)

    def _fail(self, entry: QueueEntry, record: JobRecord, cause: Exception | str) -> None:
        ended = fail_job(self._store, record, cause)
        if not is_terminal(ended):  # somebody works on it, who has not taken it from the queue
            change_entry(self._store, entry.kind, entry.id, not_before_s=time.time() + _LONGEST_PAUSE_S)
        elif ended.status == "Failed":
            logger.warning("%s has failed: %s", record.arn, ended.failure_reason)

    def _uncount(self, entry: QueueEntry) -> None:
        change_entry(self._store, entry.kind, entry.id, attempts=max(0, entry.attempts - 1), not_before_s=0.0)


def _pause_s(attempts: int) -> float:
    return min(2.0**attempts, _LONGEST_PAUSE_S)
