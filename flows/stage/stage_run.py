"""The run of a single stage: a run of its own, or a part of the pipeline's run."""

from collections.abc import Callable, Mapping

from pydantic import JsonValue

from flows.resource.cancel import REASON
from flows.stage.assets import made_by
from flows.stage.cancellation import cancelable_run
from flows.stage.orchestrator import orchestrator
from flows.stage.run_owner import begin_run_in_turn
from specs.errors import DocumentError, StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance
from tasks.storage.jobs.runs import stage_token

_FAILED = frozenset({"Failed", "TimedOut", "Canceled"})


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
