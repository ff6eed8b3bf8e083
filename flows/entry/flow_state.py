"""What a flow run ends in: Prefect's Completed, with the result, and one line that says what came of it.

A flow returns the state in the place of its result. Prefect makes the state's data the flow's result again: for who
calls the flow in Python, for who waits for its deployment's run, and for who reads the state later.
"""

from collections import Counter
from collections.abc import Sequence
from typing import TypeVar, cast

from prefect.client.schemas.objects import State
from prefect.states import Completed

from flows.resource.abandoned_jobs import ReapedJob
from flows.stage.stage_summary import job_summary
from specs.data.run_report import PipelineReport
from tasks.storage.jobs.records import JobRecord

T = TypeVar("T")
_SUCCESS = frozenset({"Completed", "Succeeded"})


def completed_job(record: JobRecord) -> JobRecord:
    """Returns the state of a flow run that ended a job; one that Prefect shall take as it is stays as it is.

    Args:
        record: The job, or the state of a flow run that was cancelled.
    """
    if isinstance(cast("object", record), State):
        return record
    status = "" if record.status in _SUCCESS else f"{record.status}: "
    zipped = record.detail.get("zip")
    where = f"{zipped} ({record.arn})" if zipped else record.arn
    return _completed(record, f"{status}{job_summary(record)}: {where}")


def completed_run(report: PipelineReport) -> PipelineReport:
    """Returns the state of a flow run that ran a document to its end.

    Args:
        report: Of the run, or the state of a flow run that was cancelled.
    """
    if isinstance(cast("object", report), State):
        return report
    return _completed(report, run_sentence(report))


def completed_reaping(found: Sequence[ReapedJob]) -> list[ReapedJob]:
    """Returns the state of a flow run that looked for abandoned jobs."""
    statuses = Counter(each.status for each in found)
    counts = ", ".join(f"{number} now {status}" for status, number in sorted(statuses.items()))
    number = f"{len(found)} abandoned job{'' if len(found) == 1 else 's'}"
    return _completed([*found], f"{number}: {counts}" if found else "no abandoned job")


def run_sentence(report: PipelineReport) -> str:
    """Returns a run in one line: the verdict, whether anything was shipped, and the first figures of each stage."""
    shipped = {True: "shipped", False: "not shipped", None: ""}[report.shipped]
    answer = ", ".join(part for part in (report.verdict or "", shipped) if part)
    counts = "; ".join(stage.summary.partition("; ")[0] for stage in report.stages if stage.name != "gate")
    return ": ".join(part for part in (answer, counts) if part) + f" ({report.run})"


def _completed(data: T, message: str) -> T:
    return cast("T", Completed(data=data, message=message))
