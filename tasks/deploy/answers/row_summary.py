"""Summary of a deployment for a person: a row for each robot, and a sentence."""

from collections import Counter

from specs.arn import parse_reference
from specs.robomaker.deployment import DescribeDeploymentJobResponse, RobotDeployment
from tasks.deploy.trust.trust_choice import UNSIGNED_ALARM
from tasks.deploy.trust.trust_record import is_unsigned
from tasks.storage.jobs.records import JobRecord

COLUMNS = ("robot", "status", "step", "done", "why")


def robot_cells(robot: RobotDeployment) -> tuple[str, str, str, str, str]:
    """Returns what there is to say of a robot, in the order of `COLUMNS`."""
    detail = robot.progressDetail
    percent = detail.percentDone if detail else None
    return (
        parse_reference(robot.arn or "").path,
        robot.status or "",
        (detail.currentProgress or "") if detail else "",
        f"{percent:.0f} %" if percent is not None else "",
        ": ".join(filter(None, (robot.failureCode, robot.failureReason))),
    )


def robot_rows(job: DescribeDeploymentJobResponse) -> list[dict[str, str]]:
    """Returns a row a robot, by column."""
    return [dict(zip(COLUMNS, robot_cells(robot), strict=True)) for robot in job.robotDeploymentSummary or ()]


def robot_counts(job: DescribeDeploymentJobResponse) -> str:
    """Returns how many robots are in which state, such as ``2 Failed, 3 InSync``."""
    counts = Counter(robot.status for robot in job.robotDeploymentSummary or ())
    return ", ".join(f"{count} {status}" for status, count in sorted(counts.items(), key=str)) or "no robot"


def deployment_sentence(job: DescribeDeploymentJobResponse, record: JobRecord) -> str:
    """Returns how a deployment went, in a sentence, with the alarm if it is unsigned."""
    sentence = f"{job.status}: {robot_counts(job)}" + (f"; {job.failureReason}" if job.failureReason else "")
    return f"{sentence}. {UNSIGNED_ALARM}" if is_unsigned(record) else sentence
