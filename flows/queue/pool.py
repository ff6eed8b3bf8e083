"""Hands queued jobs to a work pool of Prefect's, as flow runs of a deployment for each kind of job.

Run as ``python -m flows.queue.pool POOL STORE`` by `flows.queue.supervisor`. Several gateways may hand over the same
queue: the number of a handing-over is part of its idempotency key, so that all of them name one flow run. A flow run
that ended without its job, or whose process is gone, is followed by another.

Prefect finds the flows of queued jobs by their names in this module; a pool's worker runs one process or container for
each job. Each flow takes the job's turn itself, so that a job that was handed over twice is done once.
"""

import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from uuid import UUID

import httpx
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.objects import FlowRun, StateType
from prefect.exceptions import ObjectNotFound
from prefect.utilities.callables import parameter_schema

from flows.pipeline.run_turns import require_success
from flows.prefect.flow_runs import end_abandoned_flow_run
from flows.queue.attempts import Attempts
from flows.queue.lane import Signals
from flows.queue.queued_flows import TAG, end_in_flow, queued_flow
from flows.queue.supervisor import log_to_stderr
from flows.resources.kinds import cancel_resource
from specs.errors import DocumentError, SimyardError, StageFailed, StoreAway
from specs.job_kinds import JobKind
from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimWatch
from tasks.storage.jobs.queue import QueueEntry, QueueView, change_entry, find_entry, turn_key
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.store_url import open_store, store_id

_MODULE = "flows.queue.pool"  # where Prefect finds the flows, also when this is the program that hands jobs over
_DESCRIPTION = "A job of RoboMaker's API, handed over by simyard serve --pool or simyard worker --pool."
_ASK_S = 10.0
# A process needs so long to begin; then its turn's claim tells whether it lives.
_START_S = 60.0
_PENDING_S = 300.0
_ENDED = frozenset({StateType.COMPLETED, StateType.FAILED, StateType.CRASHED, StateType.CANCELLED})
logger = logging.getLogger(__name__)


def end_at_pool(store: Store, job: str, kind: JobKind) -> JobRecord:
    """Returns the record of a job that this flow run has ended.

    Args:
        store: Where it is.
        job: Its id.
        kind: The job's.

    Raises:
        StageFailed: It ended without success, or waits for another attempt.
    """
    prepare_devices()
    entry = find_entry(store, kind, job)
    if entry:
        Attempts(store).attempt(entry, lambda _: end_in_flow(store, kind, job))
    record = read(store, kind, job)
    if not is_terminal(record):
        why = f"{job} is {record.status}: another process works on it, or another attempt follows"
        raise StageFailed("InternalServiceError", why, record.arn)
    return record if kind == "deployment-job" else require_success(record)


world_generation = queued_flow("world-generation-job", partial(end_at_pool, kind="world-generation-job"), _DESCRIPTION)
world_export = queued_flow("world-export-job", partial(end_at_pool, kind="world-export-job"), _DESCRIPTION)
simulation_batch = queued_flow("simulation-job-batch", partial(end_at_pool, kind="simulation-job-batch"), _DESCRIPTION)
deployment_sync = queued_flow("deployment-job", partial(end_at_pool, kind="deployment-job"), _DESCRIPTION)


FLOWS: Mapping[JobKind, Flow[..., object]] = {
    "world-generation-job": world_generation,
    "world-export-job": world_export,
    "simulation-job-batch": simulation_batch,
    "deployment-job": deployment_sync,
}


class PoolDesk:
    """Hands the jobs of a queue to a work pool, and looks after what it has handed over.

    Args:
        store: Where the queue is.
        pool: The pool's name.

    Raises:
        DocumentError: Prefect's server has no such pool.
    """

    def __init__(self, store: Store, pool: str) -> None:
        self._store = store
        self._attempts = Attempts(store)
        self._asked_s: dict[str, float] = {}
        self._watches: dict[str, ClaimWatch] = {}
        with get_client(sync_client=True) as client:
            _require_pool(client, pool)
            self._deployments = {kind: _deploy(client, each, pool) for kind, each in FLOWS.items()}

    def look(self, entry: QueueEntry) -> None:
        """Hands a job over, if it has to be: for the first time, or because its flow run is lost."""
        if self._attempts.drop_if_done(entry) or entry.not_before_s > time.time():
            return
        with get_client(sync_client=True) as client:
            if not entry.flow_run or (self._is_due(entry.id) and self._is_lost(client, entry)):
                self._hand_over(client, entry)

    def _is_due(self, job: str) -> bool:
        now_s = time.monotonic()
        if now_s - self._asked_s.get(job, 0.0) < _ASK_S:
            return False
        self._asked_s[job] = now_s
        return True

    def _hand_over(self, client: SyncPrefectClient, seen: QueueEntry) -> None:
        entry = find_entry(self._store, seen.kind, seen.id)
        if entry is None or entry.handed_over != seen.handed_over:  # another gateway was faster
            return
        number = entry.handed_over + 1
        flow_run = client.create_flow_run_from_deployment(
            self._deployments[entry.kind],
            parameters={"job": entry.id, "store": self._store.url},
            name=entry.id,
            tags=[entry.id, TAG],
            idempotency_key=f"{store_id(self._store)}-{entry.id}-{entry.queued_at_s}-{number}",
        )
        change_entry(self._store, entry.kind, entry.id, handed_over=number, flow_run=str(flow_run.id))
        logger.info("%s was handed over as flow run %s", entry.id, flow_run.id)

    def _is_lost(self, client: SyncPrefectClient, entry: QueueEntry) -> bool:
        """Returns whether a job's flow run has ended without it, or never will."""
        try:
            flow_run = client.read_flow_run(UUID(entry.flow_run))
        except ObjectNotFound:
            return True
        state, since_s = flow_run.state_type, _since_s(flow_run)
        if state == StateType.CANCELLED:  # before a process began it, which would have cancelled the job
            with suppress(DocumentError):
                cancel_resource(self._store, read(self._store, entry.kind, entry.id).arn)
        if state in _ENDED:
            return since_s > _ASK_S
        gone = state == StateType.PENDING and since_s > _PENDING_S
        if state in {StateType.RUNNING, StateType.CANCELLING}:
            watch = self._watches.setdefault(entry.id, ClaimWatch(self._store, turn_key(entry.kind, entry.id)))
            gone = watch.is_left() and since_s > _START_S
        if gone:
            end_abandoned_flow_run(entry.flow_run, "Its process ended without a word, and its job is handed over again")
        return gone


def _require_pool(client: SyncPrefectClient, pool: str) -> None:
    try:
        client.read_work_pool(pool)
    except ObjectNotFound as exc:
        allowed = f"a work pool of {client.api_url}: prefect work-pool create {pool} --type process"
        raise DocumentError.of("--pool", repr(pool), allowed, source="command") from exc


def _deploy(client: SyncPrefectClient, flow: Flow[..., object], pool: str) -> UUID:
    """Returns the id of a flow's deployment for a pool, made or brought up to date."""
    return client.create_deployment(
        flow_id=client.create_flow_from_name(flow.name),
        name=f"api-{pool}",
        work_pool_name=pool,
        entrypoint=f"{_MODULE}.{flow.name.replace('-', '_')}",
        description=flow.description,
        tags=[TAG],
        parameter_openapi_schema=parameter_schema(flow).model_dump_for_openapi(),
        enforce_parameter_schema=True,
    )


def _since_s(flow_run: FlowRun) -> float:
    return (datetime.now(UTC) - flow_run.state.timestamp).total_seconds() if flow_run.state else 0.0


def main(pool: str, store_url: str) -> None:
    """Hands jobs over until standard input ends.

    Args:
        pool: The pool's name.
        store_url: Where the queue is.

    Raises:
        DocumentError: Prefect's server has no such pool.
    """
    signals, store = Signals(), open_store(store_url)
    signal.signal(signal.SIGTERM, signals.end)
    threading.Thread(target=signals.listen, args=(lambda: None,), name="orders", daemon=True).start()
    desk, view = PoolDesk(store, pool), QueueView(store, [*FLOWS])
    logger.info("process %d hands jobs to the work pool %s", os.getpid(), pool)
    while not signals.ending:
        signals.forget()
        try:
            look_at_all(desk.look, view.entries())
        except (SimyardError, httpx.HTTPError, RuntimeError) as exc:  # RuntimeError: Prefect's client of a server away
            logger.warning("jobs could not be handed over: %s", exc)
        signals.wait()


def look_at_all(look: Callable[[QueueEntry], None], entries: Iterable[QueueEntry]) -> None:
    """Looks at each job of a queue; one that cannot be looked at keeps nobody from the others.

    Raises:
        StoreAway: The store does not answer.
    """
    for entry in entries:
        try:
            look(entry)
        except StoreAway:
            raise
        except (SimyardError, ValueError) as exc:  # ValueError: a stranger wrote a flow run that is none
            logger.warning("%s could not be handed over: %s", entry.id, exc)


if __name__ == "__main__":
    log_to_stderr()
    try:
        main(sys.argv[1], sys.argv[2])
    except DocumentError as exc:
        sys.exit(str(exc))
