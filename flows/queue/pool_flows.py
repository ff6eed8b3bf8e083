"""The flows of queued jobs that a work pool's worker runs, one process or container for each job.

Prefect finds them by their names in this module. Each takes the job's turn itself, so that a job that was handed over
twice is done once.
"""

from functools import partial

from flows.queue.attempts import Attempts
from flows.queue.queued_flows import end_in_flow, queued_flow
from flows.stage.stage_run import require_success
from specs.errors import StageFailed
from specs.job_kinds import JobKind
from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import find_entry
from tasks.storage.jobs.records import JobRecord, is_terminal, read

_DESCRIPTION = "A job of RoboMaker's API, handed over by simyard serve --pool or simyard worker --pool."


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
