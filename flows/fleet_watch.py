"""`simyard fleet watch`: a deployment in the terminal, as the records tell it."""

import time
from collections import Counter
from collections.abc import Callable

from rich.console import Console
from rich.live import Live
from rich.table import Table

from specs.arn import parse_reference
from specs.deployment import DescribeDeploymentJobResponse, RobotDeployment
from tasks.deploy.describe import describe_deployment_job
from tasks.deploy.steering import wish_of
from tasks.storage.store import Store

_LOOK_S = 1.0
_ENDED = frozenset({"Succeeded", "Failed", "Canceled"})
_STYLES = {"InSync": "green", "Failed": "red", "NoResponse": "red", "Deploying": "cyan", "PendingNewDeployment": "cyan"}


def watch_deployment(
    store: Store, job: str, console: Console, sleep: Callable[[float], None] = time.sleep
) -> DescribeDeploymentJobResponse:
    """Returns a deployment job as it ended, having shown it until then.

    Raises:
        ResourceNotFound: No such job.
    """
    found = describe_deployment_job(store, job)
    with Live(deployment_table(found, wish_of(store, job)), console=console, refresh_per_second=4) as live:
        while found.status not in _ENDED:
            sleep(_LOOK_S)
            found = describe_deployment_job(store, job)
            live.update(deployment_table(found, wish_of(store, job)))
    return found


def deployment_table(job: DescribeDeploymentJobResponse, wish: str = "go") -> Table:
    """Returns a deployment job as a table, a row a robot; ``wish`` is what somebody wants of it."""
    robots = job.robotDeploymentSummary or ()
    counts = Counter(robot.status for robot in robots)
    told = ", ".join(f"{count} {status}" for status, count in sorted(counts.items(), key=str))
    wanted = {"pause": ", paused", "cancel": ", being canceled"}.get(wish, "") if job.status not in _ENDED else ""
    table = Table(title=f"{job.status}{wanted}: {told or 'no robot'}", caption=job.failureReason, title_justify="left")
    for name in ("robot", "status", "step", "done", "why"):
        table.add_column(name, justify="right" if name == "done" else "left", overflow="fold")
    for robot in robots:
        table.add_row(*_cells(robot), style=_STYLES.get(robot.status or "", ""))
    return table


def _cells(robot: RobotDeployment) -> tuple[str, str, str, str, str]:
    detail = robot.progressDetail
    percent = detail.percentDone if detail else None
    return (
        parse_reference(robot.arn or "").path,
        robot.status or "",
        (detail.currentProgress or "") if detail else "",
        f"{percent:.0f} %" if percent is not None else "",
        ": ".join(filter(None, (robot.failureCode, robot.failureReason))),
    )
