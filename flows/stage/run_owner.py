"""Progress of a run that another process works on, shown while this process waits for its result."""

import logging
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager

from pydantic import JsonValue

from flows.resource.cancel import CANCELED
from flows.resource.kinds import KINDS, StageProgress
from flows.stage.orchestrator import orchestrator
from specs.errors import ResourceNotFound, StageFailed
from tasks.progress.listener import report_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.jobs.holder import this_process
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import Waiting, begin_run, jobs_of

_PAUSE_S = 1.0
# Looking at a large batch is a long listing: waiting shall not be a load on the store.
_LOOKING_SHARE = 0.1
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
            orchestrator().show_wait(sentence)
        elif found.beat > beat:  # it lives; nobody has to watch it die
            orchestrator().leave_place(sentence, run)
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
