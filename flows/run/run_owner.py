"""Somebody else works on the same run: who, and how far it is, for whoever waits for its result."""

import logging
import time
from collections.abc import Callable, Mapping

from specs.errors import ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.world_jobs import WorldCount
from tasks.deploy.rollout.observation import ended, recorded_progress
from tasks.progress.listener import tell
from tasks.simulate.batch.chunk_store import chunk_numbers
from tasks.simulate.batch.job import opened
from tasks.storage.base.keys import worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.jobs.holder import this_process
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import Waiting, jobs_of

_PAUSE_S = 1.0
# Looking at a large batch is a long listing: waiting shall not be a load on the store.
_LOOKING_SHARE = 0.1
StageProgress = tuple[str, int, int]
logger = logging.getLogger(__name__)


def waiting_display(store: Store, clock: Callable[[], float] = time.monotonic) -> Waiting:
    """Returns what tells the terminal of the run that is waited for, at most once a second.

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
        tell(f"waiting for {holder_name(found)}: {stage}", done, total)
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
        at = _STAGES[kind](store, record)
        if not is_terminal(record):
            break
    return at


def _worlds(store: Store, record: JobRecord) -> StageProgress:
    counts = WorldCount.model_validate(record.request["worldCount"])
    wanted = (counts.floorplanCount or 1) * (counts.interiorCountPerFloorplan or 1)
    made = sum(1 for key in store.keys(worlds_prefix(record.id)) if key.endswith(".json"))
    return "Worlds", made, wanted


def _export(_store: Store, record: JobRecord) -> StageProgress:
    return "Export", int(is_terminal(record)), 1


def _episodes(store: Store, record: JobRecord) -> StageProgress:
    layout = opened(store, record.id).layout
    done = sum(map(layout.chunk_size, chunk_numbers(store, record.id).committed))
    return "Episodes", done, layout.episodes


def _robots(_store: Store, record: JobRecord) -> StageProgress:
    seen = recorded_progress(record)
    return "Deployment", ended(seen), max(1, len(seen))


_STAGES: Mapping[JobKind, Callable[[Store, JobRecord], StageProgress]] = {
    "world-generation-job": _worlds,
    "world-export-job": _export,
    "simulation-job-batch": _episodes,
    "deployment-job": _robots,
}
