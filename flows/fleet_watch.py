"""`simyard fleet watch`: a deployment in the terminal, as the records tell it."""

import time
from collections.abc import Callable

from rich.console import Console
from rich.live import Live
from rich.table import Table

from specs.deployment import DescribeDeploymentJobResponse
from tasks.deploy.describe import describe_deployment_job
from tasks.deploy.steering import wish_of
from tasks.deploy.telling import COLUMNS, robot_cells, told_robots
from tasks.deploy.trust.choice import UNSIGNED_ALARM
from tasks.deploy.trust.vouching import is_unsigned
from tasks.storage.records import read
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
    with Live(_table(store, job, found), console=console, refresh_per_second=4) as live:
        while found.status not in _ENDED:
            sleep(_LOOK_S)
            found = describe_deployment_job(store, job)
            live.update(_table(store, job, found))
    return found


def deployment_table(job: DescribeDeploymentJobResponse, wish: str = "go", alarm: str = "") -> Table:
    """Returns a deployment job as a table, a row a robot; ``wish`` is what somebody wants of it."""
    wanted = {"pause": ", paused", "cancel": ", being canceled"}.get(wish, "") if job.status not in _ENDED else ""
    caption = "\n".join(filter(None, (job.failureReason, alarm)))
    table = Table(title=f"{job.status}{wanted}: {told_robots(job)}", caption=caption or None, title_justify="left")
    for name in COLUMNS:
        table.add_column(name, justify="right" if name == "done" else "left", overflow="fold")
    for robot in job.robotDeploymentSummary or ():
        table.add_row(*robot_cells(robot), style=_STYLES.get(robot.status or "", ""))
    return table


def _table(store: Store, job: str, found: DescribeDeploymentJobResponse) -> Table:
    record = read(store, "deployment-job", job)
    return deployment_table(found, wish_of(store, job), UNSIGNED_ALARM if is_unsigned(record) else "")
