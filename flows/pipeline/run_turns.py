"""One run and several processes: waits for the one that works on it, works on it, and cancels what this one works on.

`simyard cancel` cancels, or Prefect's button or command. Prefect marks the flow run, and sends SIGTERM to its process
if a worker started it. A machine that goes down sends SIGTERM, too. So the orchestrator is asked whether a run was
cancelled, or only interrupted and may continue.
"""

import contextvars
import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager, suppress

from pydantic import JsonValue

from flows.pipeline.orchestrator import orchestrator
from flows.pipeline.stage_report import made_by
from flows.resources.kinds import (
    CANCELED,
    KINDS,
    REASON,
    StageProgress,
    cancel_jobs,
    end_canceled,
    require_not_canceled,
)
from specs.errors import DocumentError, ResourceNotFound, SimyardError, StageFailed
from specs.settings import chosen_workers
from tasks.progress.listener import report_progress
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.simulate.batch.chunk_store import chunk_numbers
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord, this_process
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, KIND, Waiting, begin_run, jobs_of, stage_token

_PAUSE_S = 1.0
# Looking at a large batch is a long listing: waiting shall not be a load on the store.
_LOOKING_SHARE = 0.1
_FAILED = frozenset({"Failed", "TimedOut", "Canceled"})
logger = logging.getLogger(__name__)


@contextmanager
def begin_run_in_turn(
    store: Store, identity: dict[str, JsonValue], clock: Callable[[], float] = time.monotonic
) -> Generator[JobRecord, None, None]:
    """Yields the run of a document as `begin_run` does; while another process works on it, this one tells so.

    It shows the other's progress, at most once a second, and in Prefect's state whom it waits for. A flow run that
    somebody cancels while it waits ends, and the other one goes on.

    Args:
        store: Where the run is.
        identity: See `begin_run`.
        clock: Seconds that never go back.

    Raises:
        StageFailed: Prefect has cancelled this flow run while it waited.
    """
    with ExitStack() as wait:
        waiting: Waiting | None = None

        def wait_visibly(run: JobRecord, found: ClaimRecord) -> None:
            nonlocal waiting
            if found.released:
                return
            if waiting is None:
                waiting = _waiting(store, wait.enter_context(orchestrator().watch_cancellation()), clock)
            waiting(run, found)

        with begin_run(store, identity, wait_visibly, orchestrator().awaited_run()) as run:
            wait.close()
            if waiting and not is_terminal(run):
                orchestrator().show_work()
            yield run


def _waiting(store: Store, is_canceled: Callable[[], bool], clock: Callable[[], float]) -> Waiting:
    next_s, holder, beat = clock(), "", 0

    def waiting(run: JobRecord, found: ClaimRecord) -> None:
        nonlocal next_s, holder, beat
        began_s = clock()
        if began_s < next_s:
            return
        sentence = f"{holder_name(found)} works on {run.arn}, and this run waits for its result"
        if found.owner != holder:
            holder, beat = found.owner, found.beat
            logger.info(sentence)
            orchestrator().show_waiting(sentence)
        elif found.beat > beat:  # it lives; nobody has to watch it die
            orchestrator().requeue_run(sentence, run)
        if is_canceled():
            raise StageFailed(CANCELED, f"canceled while it waited for {holder_name(found)}, which goes on", run.arn)
        stage, done, total = run_progress(store, run)
        report_progress(f"waiting for {holder_name(found)}: {stage}", done, total)
        next_s = clock() + max(_PAUSE_S, (clock() - began_s) / _LOOKING_SHARE)

    return waiting


def holder_name(holder: ClaimRecord) -> str:
    """Returns what a person calls the process that holds a claim."""
    here = holder.process.host and holder.process.host == this_process().host
    return f"process {holder.process.pid}" + ("" if here else " elsewhere")


def run_progress(store: Store, run: JobRecord) -> StageProgress:
    """Returns the stage that a run is at, and how many of how many worlds, episodes or robots of it are done."""
    at: StageProgress = ("beginning", 0, 1)
    for kind, job in jobs_of(run):
        try:
            record = read(store, kind, job)
        except ResourceNotFound:
            continue
        look = KINDS[kind].load().progress
        at = look(store, record) if look else at
        if not is_terminal(record):
            break
    return at


_LOOK_S = 1.0
PATIENCE_S = 5.0
_CHUNK_S = 10.0


@contextmanager
def cancelable_run(store: Store, run: JobRecord) -> Generator[None, None, None]:
    """Watches a run inside the ``with`` block: if it is cancelled, its job under way is too, and the run ends Canceled.

    Args:
        store: Where the run is.
        run: Its claim is held; it has not ended.

    Raises:
        StageFailed: It was cancelled.
    """
    own = orchestrator().flow_run_id
    orchestrator().end_flow_run_before(run)
    advance(store, KIND, run.id, "Running", detail=_worked_on_in(own, run), only_from={"Pending", "Running"})
    try:
        with orchestrator().watch_cancellation() as asked, _watch_run(store, run, asked):
            require_not_canceled(store, run)
            yield
    except BaseException as exc:
        if not _is_cancellation(exc, store, run, own):
            raise
        _end(store, run, exc)
        if isinstance(exc, Exception) and not _is_canceled_failure(exc):
            raise StageFailed(CANCELED, REASON, run.arn) from exc
        raise


def _worked_on_in(own: str, run: JobRecord) -> dict[str, JsonValue]:
    """Returns what a run's detail says of Prefect's flow runs: the one that works on it, or a dead one's."""
    if own:
        return {FLOW_RUN: own}
    # Who cancels the dead flow run shall not cancel this process's work; reaping ends it.
    before = run.detail.get(FLOW_RUN) or run.detail.get(FLOW_RUN_BEFORE)
    return {FLOW_RUN: "", FLOW_RUN_BEFORE: before} if before else {}


def _is_canceled_failure(exc: BaseException) -> bool:
    return isinstance(exc, StageFailed) and exc.code == CANCELED


def _is_cancellation(exc: BaseException, store: Store, run: JobRecord, own: str) -> bool:
    """Returns whether a run that ends with an exception was cancelled, and not only interrupted, or failed."""
    if _is_canceled_failure(exc):
        return True
    try:
        if read(store, KIND, run.id).status == "Canceling":
            return True
    except SimyardError as unread:
        logger.warning("whether %s is canceled could not be read: %s", run.id, unread)
    return not isinstance(exc, Exception) and _answer_within(PATIENCE_S, lambda: orchestrator().is_cancelling(own))


def _end(store: Store, run: JobRecord, exc: BaseException) -> None:
    try:
        # Workers of a cluster outlive this process: they get the time to commit what is done of their chunks.
        workers = chosen_workers()
        batches = [job for kind, job in jobs_of(run) if kind == BATCH] if workers and workers.address else []
        for batch in batches:
            with suppress(DocumentError):  # not begun, or ended
                cancel_batch(store, batch)
                end_s = time.monotonic() + _CHUNK_S
                while (chunks := chunk_numbers(store, batch)).begun != chunks.committed and time.monotonic() < end_s:
                    time.sleep(_LOOK_S)
        end_canceled(store, run)
    except SimyardError as failure:
        logger.warning("%s was canceled (%s), and could not be ended: %s", run.id, exc, failure)


@contextmanager
def _watch_run(store: Store, run: JobRecord, asked: Callable[[], bool]) -> Generator[None, None, None]:
    """Inside the block, cancels the jobs of the run, each once, as soon as somebody cancels the run."""
    left = threading.Event()

    def watch() -> None:
        known = frozenset[str]()
        while not left.wait(_LOOK_S):
            try:
                if _is_canceled(store, run, asked):
                    known |= cancel_jobs(store, run, known)
            except SimyardError as exc:  # the store may come back; nothing is lost by looking again
                logger.warning("%s could not be looked at: %s", run.id, exc)

    watching = contextvars.copy_context()  # so that it asks the same server, and its events have the same flow run
    threading.Thread(target=watching.run, args=(watch,), name=f"cancellation of {run.id}", daemon=True).start()
    try:
        yield
    finally:
        left.set()


def _is_canceled(store: Store, run: JobRecord, asked: Callable[[], bool]) -> bool:
    """Returns whether a run is cancelled; its record says so from then on, also when it was Prefect that was asked."""
    status = read(store, KIND, run.id).status
    if status == "Running" and asked():
        status = advance(store, KIND, run.id, "Canceling", only_from={"Running"}).status
    return status == "Canceling"


def _answer_within(seconds: float, question: Callable[[], bool]) -> bool:
    """Returns the answer; False if there is none in time."""
    answers: list[bool] = []
    asking = contextvars.copy_context()
    thread = threading.Thread(target=lambda: answers.append(asking.run(question)), daemon=True)
    thread.start()
    thread.join(seconds)
    return any(answers)


def run_stage(
    store: Store, stage: str, identity: Mapping[str, JsonValue], token: str | None, work: Callable[[str], JobRecord]
) -> JobRecord:
    """Returns the job that the work ended, in a run of its own when no token says that it is part of another's.

    Work is recognised by its token, so that this returns the job of a run that another process ended meanwhile.

    Args:
        store: Where runs are recorded.
        stage: The flow's name.
        identity: All that decides the outcome, for the run's number.
        token: The pipeline's token for this stage, or None.
        work: Does the stage under a token; doing it again changes nothing.
    """
    if token is not None:
        return _announced(store, work(token), token)
    with (
        orchestrator().announce_changes(),
        begin_run_in_turn(store, {"flow": stage, **identity}) as run,
    ):
        return _work_in_run(store, stage, run, work)


def _work_in_run(store: Store, stage: str, run: JobRecord, work: Callable[[str], JobRecord]) -> JobRecord:
    if run.status == "Canceled":  # maybe before it had a job, and none begins now
        raise StageFailed(run.failure_code, run.failure_reason, run.arn)
    try:
        with cancelable_run(store, run), orchestrator().tag_run(run):
            record = _announced(store, work(stage_token(run, stage)))
    except (DocumentError, StageFailed) as exc:
        advance(store, "pipeline-run", run.id, "Failed", failure_reason=str(exc))
        raise
    advance(store, "pipeline-run", run.id, "Completed", detail={"arn": record.arn})
    return record


def _announced(store: Store, job: JobRecord, token: str = "") -> JobRecord:
    """Returns the job, having told of what it made."""
    made = made_by(store, job, token)
    if made is not None:
        orchestrator().announce_asset(made)
    return job


def require_success(record: JobRecord) -> JobRecord:
    """Returns the record of a job that made something.

    Raises:
        StageFailed: The job Failed, TimedOut or was Canceled; carries its code and reason.
    """
    if record.status in _FAILED:
        reason = record.failure_reason or (REASON if record.status == "Canceled" else record.status)
        raise StageFailed(record.failure_code or record.status, reason, record.arn)
    return record
