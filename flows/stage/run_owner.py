"""Progress of a run that another process works on, shown while this process waits for its result."""

import logging
import time
from collections.abc import Callable

from flows.resource.kinds import KINDS, StageProgress
from specs.errors import ResourceNotFound
from tasks.progress.listener import report_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.jobs.holder import this_process
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import Waiting, jobs_of

_PAUSE_S = 1.0
# Looking at a large batch is a long listing: waiting shall not be a load on the store.
_LOOKING_SHARE = 0.1
logger = logging.getLogger(__name__)


def waiting_display(store: Store, clock: Callable[[], float] = time.monotonic) -> Waiting:
    """Returns a function that shows the progress of the run that is waited for, at most once a second.

    Args:
        store: Where the run is.
        clock: Seconds that never go back.
    """
    next_s, holder = clock(), ""

    def waiting(run: JobRecord, found: ClaimRecord) -> None:
        nonlocal next_s, holder
        began_s = clock()
        if began_s < next_s or found.released:
            return
        if found.owner != holder:
            holder = found.owner
            logger.info("%s works on %s, and this process waits for its result", holder_name(found), run.arn)
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
