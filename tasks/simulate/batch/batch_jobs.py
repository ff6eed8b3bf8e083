"""The jobs of a batch, described, cancelled and restarted as by RoboMaker (docs/reference/robomaker.md).

A job is `<batch>/<index>`; nothing is stored for it alone. What was asked of it follows from the batch's plan, and what
came of it stands in its chunk. A job is *pending* until its chunk is begun, *created* from then on; in a batch that
ended before it was begun it is *failed*: it never became a job.

Nothing here needs more memory for a batch with more jobs: what is asked for in order is read chunk by chunk.
"""

import functools
import itertools
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar, cast

from pydantic import JsonValue

from specs.arn import arn, parse_reference
from specs.base import Spec
from specs.data.episode import EpisodeResult
from specs.data.outcomes import failed_tags, outcome_tags, with_outcome
from specs.data.physics import application_variables
from specs.errors import DocumentError, ResourceNotFound
from specs.robomaker.simulation import SimulationJobRequest
from specs.robomaker.simulation_descriptions import (
    BatchDescribeSimulationJobResponse,
    DescribeSimulationJobBatchResponse,
    DescribeSimulationJobResponse,
    FailedCreateSimulationJobRequest,
    SimulationJob,
    SimulationJobSummary,
)
from tasks.simulate.batch.batch_record import (
    GOING,
    KIND,
    STOP_CODES,
    STOPPING,
    OpenBatch,
    canceled_before_begun,
    canceled_job_mark,
    canceled_job_time,
    canceled_job_times,
    canceled_jobs,
    etags_of,
    job_of,
    load_batch,
    lost_job_code,
    plan_of,
    restarted_job_mark,
    restarted_jobs,
)
from tasks.simulate.batch.chunk_store import chunk_start, chunk_times, committed_chunk
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import entries, is_single, policy_and_tags
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, is_terminal
from tasks.storage.store_url import store_id

_CHUNKS_KEPT = 4
_LONGEST_REASON = 1024  # GenericString
_Document = dict[str, JsonValue]


class JobCounts(Spec):
    """How many of a batch's jobs were not begun yet, were begun, and never will be."""

    pending: int
    created: int
    failed: int


class Jobs:
    """The jobs of a batch, as they stood when this was made."""

    def __init__(self, store: Store, batch: str, record: JobRecord | None = None) -> None:
        """Reads the batch's record, and which of its chunks were begun.

        Args:
            store: Where the batch is.
            batch: Its id.
            record: Its record, if that was read just now.

        Raises:
            ResourceNotFound: No such batch.
        """
        self._batch = OpenBatch(store, batch, Layout(plan_of(record))) if record else load_batch(store, batch)
        self.record = record or self._batch.record()
        self._ended = is_terminal(self.record)
        self._store_id = store_id(store)
        self._chunks = chunk_times(store, batch)
        self._canceled, self._restarted = canceled_jobs(self.record), restarted_jobs(self.record)
        self._canceled_s, self._etags = canceled_job_times(self.record), etags_of(self.record)
        self._never_begun = canceled_before_begun(self.record)
        self._entries, self._is_single = entries(self.record), is_single(self.record)
        self._rows = functools.lru_cache(maxsize=_CHUNKS_KEPT)(self._read_rows)

    def counts(self) -> JobCounts:
        """Returns how many jobs stand where."""
        layout = self._batch.layout
        created = sum(layout.chunk_size(number) for number in self._chunks.begun)
        others = layout.episodes - created
        return JobCounts(pending=0 if self._ended else others, created=created, failed=others if self._ended else 0)

    def created(self, first: int = 0) -> Iterator[SimulationJobSummary]:
        """Yields a summary of each job that was begun, by index, from the index ``first`` on."""
        return (SimulationJobSummary.model_validate(self._summary(index)) for index in self._indices(first, begun=True))

    def listed(self, first: int = 0, statuses: Collection[str] = ()) -> Iterator[tuple[int, _Document]]:
        """Yields index and summary of each job that lists show, by index: those that were begun, and a single job.

        Args:
            first: Where to begin.
            statuses: Only jobs of these, if there are any.
        """
        for index in self._listed_indices(first):
            if not statuses or self._state(index)["status"] in statuses:
                yield index, self._summary(index)

    def summaries_by_chunk(self) -> Iterator[tuple[int, _Document]]:
        """Yields what `listed` yields, chunk by chunk, so that each is read once also if the plan was shuffled."""
        if is_single(self.record):
            yield from self.listed()
            return
        for number in sorted(self._chunks.begun):
            for request in self._batch.layout.chunk(number).requests:
                yield request.index, self._summary(request.index)

    @property
    def episodes(self) -> int:
        """How many jobs the batch asks for."""
        return self._batch.layout.episodes

    def _listed_indices(self, first: int) -> Iterator[int]:
        if is_single(self.record):
            return iter(range(first, 1))
        return self._indices(first, begun=True)

    def pending(self) -> Iterator[SimulationJobRequest]:
        """Yields what is asked of each job that is still to be begun; a single job is no entry of a batch."""
        if not self._ended and not is_single(self.record):
            for index in self._indices(0, begun=False):
                yield SimulationJobRequest.model_validate(self._asked(index))

    def failed(self) -> Iterator[FailedCreateSimulationJobRequest]:
        """Yields what was asked of each job that was not begun before the batch ended, and why it was not."""
        if self._ended:
            for index in self._indices(0, begun=False):
                asked = {} if is_single(self.record) else {"request": self._asked(index)}
                yield FailedCreateSimulationJobRequest.model_validate(
                    {**asked, **self._why_not_begun(), "failedAt": self.record.updated_at_s}
                )

    def require_job(self, index: int) -> None:
        """Does nothing for a job; a request of a batch that ended before it became one has no ARN.

        A single job is one from the call that made it on.

        Raises:
            ResourceNotFound: It never became a job.
        """
        begun = self._batch.layout.chunk_of(index) in self._chunks.begun
        if not self._ended or begun or is_single(self.record):
            return
        why = ": ".join(str(text) for text in self._why_not_begun().values() if text)
        allowed = (
            f"a request that never became a job ({why}); simyard describe {self._batch.id} has it in failedRequests"
        )
        raise ResourceNotFound.of("simulation-job", f"'{self._batch.id}/{index}'", allowed)

    def described(self, index: int) -> _Document:
        """Returns a job as DescribeSimulationJob answers.

        Raises:
            ResourceNotFound: It never became one.
        """
        self.require_job(index)
        chunk = self._batch.layout.chunk_of(index)
        start = chunk_start(self._batch.store, self._batch.id, chunk)
        asked = {
            key: value for key, value in self._asked(index).items() if key in DescribeSimulationJobResponse.model_fields
        }
        if "dataSources" in asked:
            asked["dataSources"] = [self._source(source) for source in cast("list[_Document]", asked["dataSources"])]
        restarted_s = self._restarted.get(index, 0.0)
        started: _Document = {"lastStartedAt": max(start.started_at_s, restarted_s)} if start else {}
        tags = with_outcome(cast("Mapping[str, str]", asked.get("tags") or {}), self.outcome_tags(index))
        told: _Document = {"tags": cast("JsonValue", tags)} if tags else {}
        return {"failureBehavior": "Fail", **asked, **self._identity(index), **self._state(index), **started, **told}

    def outcome_tags(self, index: int) -> dict[str, str]:
        """Returns the tags that say what came of a job; none before its end, and for one that was cancelled."""
        row = self._rows(self._batch.layout.chunk_of(index)).get(index)
        if row is not None:
            return outcome_tags(row)
        state = self._state(index)
        return failed_tags(str(state["failureCode"])) if state["status"] == "Failed" else {}

    def _source(self, source: _Document) -> _Document:
        """Returns a data source as the answer has it: keys with the ETag that their files had; folders have none."""
        keys = cast("list[str]", source["s3Keys"])
        etags = [self._etags.get(f"{source['s3Bucket']}/{key}") for key in keys]
        return {**source, "s3Keys": [{"s3Key": key, "etag": tag} for key, tag in zip(keys, etags, strict=True)]}

    def _summary(self, index: int) -> _Document:
        request = self._batch.layout.request(index)
        asked = self._entries[self._batch.layout.template_of(index)]
        sources = [source["name"] for source in cast("list[_Document]", asked.get("dataSources") or [])]
        return {
            **self._identity(index),
            "status": self._state(index)["status"],
            "dataSourceNames": cast("JsonValue", sources or None),
            "computeType": cast("_Document", asked.get("compute") or {}).get("computeType"),
            "robotApplicationNames": None if request.alone else [request.robot.name],
            "simulationApplicationNames": [request.scenario.name],
        }

    def _identity(self, index: int) -> _Document:
        return {
            "arn": arn("simulation-job", self._store_id, f"{self._batch.id}/{index}"),
            "name": f"{self._batch.id}-{index}",
            "lastUpdatedAt": self._updated_s(index),
        }

    def _updated_s(self, index: int) -> float:
        """Returns when a job last changed: its lanes began or ended, or somebody cancelled or restarted it, or all."""
        chunk, record = self._batch.layout.chunk_of(index), self.record
        noted = (self._chunks.begun_s, self._chunks.committed_s)
        own = (self._restarted.get(index), self._canceled_s.get(index))
        at_s = max(at_s for at_s in (record.created_at_s, *own, *(each.get(chunk) for each in noted)) if at_s)
        row, stopped = self._rows(chunk).get(index), record.status in STOPPING
        if (row is None and (stopped or self._ended)) or (row and self._ended and self._is_kept(row)):
            return record.updated_at_s
        # What was copied says when it was copied.
        return min(at_s, record.updated_at_s) if self._ended else at_s

    def _is_kept(self, row: EpisodeResult) -> bool:
        """Returns whether a job failed, and keeps its place until its batch ends, as RoboMaker kept its host."""
        return row.status == "Failed" and self._batch.layout.request(row.index).failure_behavior == "Continue"

    def _state(self, index: int) -> _Document:
        chunk = self._batch.layout.chunk_of(index)
        row = self._rows(chunk).get(index)
        if row is not None:
            return self._state_of(row)
        if self._ended:
            why = self._why_not_begun()
            return {**why, "status": "Canceled" if self.record.status in STOP_CODES else "Failed"}
        return {"status": self._active(index, chunk)}

    def _active(self, index: int, chunk: int) -> str:
        begun = chunk in self._chunks.begun
        if index in self._canceled:  # its row is still to be written, and says so
            return "Terminating" if begun and index not in self._never_begun else "Canceled"
        if self.record.status in STOPPING and begun:
            return "Terminating"
        if not begun:
            # An entry of a batch waits for its turn; a single job is what its worker prepares.
            return "Preparing" if self._is_single and self.record.status == "InProgress" else "Pending"
        return "Restarting" if index in self._restarted else "Running"

    def _state_of(self, row: EpisodeResult) -> _Document:
        state: _Document = {"status": row.status, "simulationTimeMillis": round(1000 * row.simulated_s)}
        if row.failure_reason:
            state["failureReason"] = " ".join(row.failure_reason.split())[:_LONGEST_REASON]
        if row.failure_code:
            state["failureCode"] = row.failure_code
        if row.status == "Completed" and self._is_output_refused():
            return {**state, **self._why_not_begun(), "status": "Failed"}
        return {**state, "status": "RunningFailed"} if not self._ended and self._is_kept(row) else state

    def _is_output_refused(self) -> bool:
        """Returns whether nothing that the batch's jobs did could be written into their bucket."""
        return self.record.status == "Failed" and lost_job_code(self.record) == "BadPermissionsS3Output"

    def _why_not_begun(self) -> _Document:
        code = STOP_CODES.get(self.record.status) or lost_job_code(self.record)
        return {"failureCode": code, "failureReason": self.record.failure_reason}

    def _indices(self, first: int, *, begun: bool) -> Iterator[int]:
        layout = self._batch.layout
        if self._chunks.begun == frozenset(range(layout.chunks)) and not begun:
            return
        for start in range(first, layout.episodes, layout.plan.lanes):
            end = min(start + layout.plan.lanes, layout.episodes)
            chunks = layout.chunks_between(start, end)
            of_kind = {number for number in chunks if (number in self._chunks.begun) == begun}
            for index in range(start, end) if of_kind else ():
                if len(of_kind) == len(chunks) or layout.chunk_of(index) in of_kind:
                    yield index

    def _read_rows(self, chunk: int) -> dict[int, EpisodeResult]:
        if chunk not in self._chunks.committed_s:
            return {}
        return {row.index: row for row in committed_chunk(self._batch.store, self._batch.id, chunk) or ()}

    def _asked(self, index: int) -> _Document:
        """Returns the entry of the batch that the job came from, with its own world and variables."""
        entry = dict(self._entries[self._batch.layout.template_of(index)])
        request = self._batch.layout.request(index)
        for kind, resolved in (("robotApplications", request.robot), ("simulationApplications", request.scenario)):
            if kind == "robotApplications" and request.alone:
                continue
            (use,) = cast("list[_Document]", entry[kind])
            values = request.environment if kind == "robotApplications" else request.judge_variables
            launch = self._launch(cast("_Document", use["launchConfig"]), application_variables(values))
            entry[kind] = [{**use, "applicationVersion": resolved.version, "launchConfig": launch}]
        (scenario,) = cast("list[_Document]", entry["simulationApplications"])
        world = arn("world", self._store_id, request.world)
        entry["simulationApplications"] = [{**scenario, "worldConfigs": [{"world": world}]}]
        return entry

    def _launch(self, config: _Document, environment: Mapping[str, str]) -> _Document:
        """Returns a launch configuration with the values that its own and the swept variables have in an episode."""
        own = cast("_Document", config.get("environmentVariables") or {})
        values: _Document = {name: environment[name] for name in sorted(own.keys() | self._batch.plan.sweep.keys())}
        return {**config, "environmentVariables": values} if values else config


T = TypeVar("T")
_MOST_SHOWN = 10_000  # of each list of a batch; they take 0.3 s and 3 MB (docs/reference/robomaker.md, section 4)


def describe_batch(store: Store, batch: str) -> DescribeSimulationJobBatchResponse:
    """Returns a batch with its pending, created and failed requests, at most 10,000 of each.

    RoboMaker's batches had 1,000 at most. A matrix may make more, of which `batch_notes` tells, and `list_jobs` yields
    them all.

    Raises:
        ResourceNotFound: No such batch.
    """
    jobs = Jobs(store, batch)
    record = jobs.record
    policy, tags = policy_and_tags(record)
    return DescribeSimulationJobBatchResponse(
        arn=record.arn,
        status=record.status,  # pyright: ignore[reportArgumentType] - checked by pydantic
        createdAt=record.created_at_s,
        lastUpdatedAt=record.updated_at_s,
        clientRequestToken=record.token,
        failureCode="InternalServiceError" if record.failure_code else None,  # a batch has no other
        failureReason=record.failure_reason or None,
        batchPolicy=policy,
        pendingRequests=_few(jobs.pending()),
        createdRequests=_few(jobs.created()) or (),
        # Programs count these two; only pendingRequests may not be empty.
        failedRequests=_few(jobs.failed()) or (),
        tags=tags,
    )


def batch_notes(store: Store, name: str) -> Iterator[str]:
    """Yields a line for each list that the answer about a batch does not hold in full; for no batch, none."""
    parsed = parse_reference(name)
    if parsed.kind != KIND:
        return
    counts = Jobs(store, parsed.path).counts()
    jobs = counts.pending + counts.created + counts.failed
    for field in ("pending", "created", "failed"):
        if (count := int(getattr(counts, field))) > _MOST_SHOWN:
            where = f"simyard list simulation-jobs shows all jobs, {parsed.path}/0 to {parsed.path}/{jobs - 1}"
            yield f"{field}Requests has the first {_MOST_SHOWN:,} of {count:,}: {where}"


def describe_job(store: Store, path: str) -> DescribeSimulationJobResponse:
    """Returns one job of a batch.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such batch, or it has no such job, or that never became one.
    """
    batch, index = job_of(store, path)
    return DescribeSimulationJobResponse.model_validate(Jobs(store, batch.id).described(index))


def batch_describe_jobs(store: Store, jobs: Sequence[str]) -> BatchDescribeSimulationJobResponse:
    """Returns several jobs, and the ARNs of those that do not exist.

    Args:
        store: Where their batches are.
        jobs: ARNs, at most 100.
    """
    found: list[SimulationJob] = []
    missing: list[str] = []
    batches = functools.cache(lambda batch: Jobs(store, batch))  # as they stand now, each read once
    for job in jobs:
        try:
            batch, index = job_of(store, _job_path(job))
            found.append(SimulationJob.model_validate(batches(batch.id).described(index)))
        except ResourceNotFound:
            missing.append(job)
    return BatchDescribeSimulationJobResponse(jobs=tuple(found), unprocessedJobs=tuple(missing) or None)


def _job_path(reference: str) -> str:
    """Returns ``<batch>/<index>`` of a job's ARN; what is none is as unknown as a job that is gone.

    Raises:
        ResourceNotFound: It names no job.
    """
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise _unknown(reference) from exc
    if parsed.kind not in {None, "simulation-job"}:
        raise _unknown(reference)
    return parsed.path


def _unknown(reference: str) -> ResourceNotFound:
    return ResourceNotFound.of("jobs", repr(reference), "the ARN of a simulation job")


def _few(found: Iterable[T]) -> tuple[T, ...] | None:
    return tuple(itertools.islice(found, _MOST_SHOWN)) or None


# See docs/reference/robomaker.md, sections 3 and 4, and docs/decisions/0008.
def cancel_batch(store: Store, batch: str) -> JobRecord:
    """Returns the record of a batch that is being cancelled: who works on it stops within seconds.

    Episodes that are done keep their results; the others become Canceled. Cancelling it again changes nothing.

    Raises:
        ResourceNotFound: No such batch.
        DocumentError: It has ended, or is about to.
    """
    record = advance(store, KIND, batch, "Canceling", only_from=GOING | {"Canceling"})
    if record.status != "Canceling":
        raise _refused(batch, f"a batch that is in progress; this one is {record.status}")
    return record


def cancel_job(store: Store, path: str) -> None:
    """Cancels one job of a batch: the others do not notice, and the batch's lanes go on.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such job, or its batch ended before it became one.
        DocumentError: It has ended, or its batch has, or is about to.
    """
    batch, index = job_of(store, path)
    chunk = batch.layout.chunk_of(index)
    begun = chunk_start(store, batch.id, chunk) is not None
    mark: dict[str, JsonValue] = {canceled_job_mark(index): begun, canceled_job_time(index): time.time()}
    ended = _ended_jobs(batch, chunk)
    record = batch.record()
    while index not in ended and record.status in GOING and not mark.keys() <= record.detail.keys():
        # Only if the batch still stands as it was read: a mark on one that has ended would mean nothing.
        record = advance(store, KIND, batch.id, record.status, only_from={record.status}, detail=mark)
    if index not in ended and record.status in GOING:
        ended = _ended_jobs(batch, chunk)  # what was committed before the mark has ended without it
        if ended.get(index, "Canceled") == "Canceled":
            return
    Jobs(store, batch.id).require_job(index)
    status = ended.get(index, f"in a batch that is {record.status}")
    raise _refused(path, f"a job that has not ended; this one is {status}")


def _ended_jobs(batch: OpenBatch, chunk: int) -> dict[int, str]:
    """Returns the status of each job of a chunk that is committed."""
    return {row.index: row.status for row in committed_chunk(batch.store, batch.id, chunk) or ()}


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError.of("arn", repr(value), allowed, source="simyard")


def restart_job(store: Store, path: str) -> None:
    """Marks a running job as begun anew, with the configuration and the bundles of its batch.

    It is Restarting until it ends. A result follows from the request alone, so that its lane goes on: a second run
    would give the same row (docs/decisions/0008).

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It is not running: it has ended, was not begun, or is being stopped.
    """
    batch, index = job_of(store, path)
    mark = restarted_job_mark(index)
    while True:
        jobs = Jobs(store, batch.id)
        status = str(jobs.described(index)["status"])
        if status not in {"Running", "Restarting"} or jobs.record.status not in GOING:
            raise _not_running(path, status)
        # Only if the batch still stands as it was read: a mark on one that is being stopped would mean nothing.
        stood = jobs.record.status
        record = advance(store, KIND, batch.id, stood, only_from={stood}, detail={mark: time.time()})
        if record.status == stood and mark in record.detail:
            return


def _not_running(path: str, status: str) -> DocumentError:
    allowed = f"a job that is running; this one is {status}. To test new content of its applications, run the document"
    return DocumentError.of("arn", repr(path), f"{allowed} again", source="simyard")
