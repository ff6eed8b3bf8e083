"""`simyard fleet watch`: shows a deployment in the terminal, robot by robot, until it ends."""

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from specs.arn import parse_reference
from specs.robomaker.deployment import DescribeDeploymentJobResponse
from specs.untrusted_text import terminal_line
from tasks.deploy.fleet.fleet_registry import fleet_name, members, read_fleet
from tasks.deploy.fleet_descriptions import (
    ROBOT_COLUMNS,
    DeploymentView,
    RobotNow,
    robot_cells,
    robots_now,
    view_deployment,
)
from tasks.deploy.rollout.observation import ABORTED
from tasks.deploy.rollout.operator_commands import active_deployment, command_of
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM, is_unsigned
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimWatch
from tasks.storage.jobs.records import is_terminal, read

_KIND = "deployment-job"
_LOOK_S = 1.0
_ENDED = frozenset({"Succeeded", "Failed", "Canceled"})
_STYLES = {"InSync": "green", "Failed": "red", "NoResponse": "red", "Deploying": "cyan", "PendingNewDeployment": "cyan"}
_ONLY_CHANGES = "agents report changes only: whether an agent or its version still runs is not known here"
ABANDONED = "nobody works on it: the command that began it, given again, continues; simyard cancel ends it"


def watch_deployment(
    store: Store, job: str, console: Console, sleep: Callable[[float], None] = time.sleep
) -> DescribeDeploymentJobResponse:
    """Returns a deployment job as it ended, having shown it until then.

    Args:
        store: Where the job is.
        job: Its id.
        console: Where it is shown.
        sleep: Waits so many seconds.

    Raises:
        ResourceNotFound: No such job.
    """
    found = view_deployment(store, job)
    claim = ClaimWatch(store, claim_key(_KIND, job))
    with Live(_view(store, job, found, claim), console=console, refresh_per_second=4) as live:
        while found.job.status not in _ENDED:
            sleep(_LOOK_S)
            found = view_deployment(store, job)
            live.update(_view(store, job, found, claim))
    return found.job


def next_deployment(store: Store, fleet: str, sleep: Callable[[float], None] = time.sleep) -> str:
    """Returns the id of a fleet's deployment that is under way, having waited until there is one.

    Raises:
        ResourceNotFound: No such fleet.
    """
    ended = read_fleet(store, fleet).deployment
    if ended and not is_terminal(read(store, _KIND, ended)):
        return ended
    while (latest := read_fleet(store, fleet).deployment) == ended:
        sleep(_LOOK_S)
    return latest


def fleet_notes(store: Store, fleet: str) -> list[str]:
    """Returns what RoboMaker's answer leaves out: whether the fleet's deployment is paused, and what each robot runs.

    Raises:
        ResourceNotFound: No such fleet.
    """
    name, job = read_fleet(store, fleet).name, active_deployment(store, fleet)
    robots = robots_now(store, (robot.name for robot in members(store, name)))
    return [*(wish_notes(store, job) if job else ()), *map(_has_line, robots), *([_ONLY_CHANGES] if robots else [])]


def _has_line(robot: RobotNow) -> str:
    """Returns what a robot had when its agent reported last: nobody else knows whether it still runs."""
    if robot.reported_s is None:
        return f"{robot.name} has {robot.runs}; its agent has never reported"
    minutes = max(0.0, time.time() - robot.reported_s) / 60
    age = f"{minutes:.0f} min" if minutes < 120 else f"{minutes / 60:.0f} h"
    return f"{robot.name} has {robot.runs}; its agent last reported {age} ago"


def wish_notes(store: Store, job: str) -> list[str]:
    """Returns a line for a deployment that is under way and paused, or being canceled; nothing for any other.

    Raises:
        ResourceNotFound: No such job.
    """
    record = read(store, _KIND, job)
    fleet = fleet_name(str(record.request["fleet"]))
    wishes = {"pause": f"paused; simyard fleet resume {fleet} lets it go on", "cancel": "being canceled"}
    wanted = wishes.get(command_of(store, job))
    return [f"{job} is {wanted}"] if wanted and not is_terminal(record) else []


def deployment_table(view: DeploymentView, wish: str = "go", now: Mapping[str, RobotNow] | None = None) -> Table:
    """Returns a deployment job as a table, a row a robot.

    Args:
        view: What is shown.
        wish: ``go``, ``pause`` or ``cancel``.
        now: The robots since it ended, by name: what they reported last is shown.
    """
    job, wanted = view.job, {"pause": ", paused", "cancel": ", being canceled"}.get(wish, "")
    title = f"{job.status}{wanted if job.status not in _ENDED else ''}: {view.standing}"
    table = Table(title=Text(terminal_line(title)), title_justify="left")
    for name in ROBOT_COLUMNS:
        table.add_column(name, justify="right" if name == "done" else "left", overflow="fold")
    runs = {**view.runs, **{name: each.runs for name, each in (now or {}).items()}}
    for robot in job.robotDeploymentSummary or ():
        # Text, and not str: what a robot or a stranger wrote is no markup.
        cells = (Text(terminal_line(cell)) for cell in robot_cells(robot, runs))
        # One that was not asked runs what it ran.
        table.add_row(*cells, style="" if robot.failureCode == ABORTED else _STYLES.get(robot.status or "", ""))
    return table


def _changed_robots(job: DescribeDeploymentJobResponse, now: Mapping[str, RobotNow]) -> list[str]:
    """Returns a line for each robot whose status has changed since its deployment ended."""
    lines: list[str] = []
    for robot in job.robotDeploymentSummary or ():
        name = parse_reference(robot.arn or "").path
        since = now.get(name)
        if since and since.deployment == parse_reference(job.arn or "").path and since.status != robot.status:
            lines.append(f"since then {name} is {since.status}, and runs {since.runs}; {since.why}".rstrip("; "))
    return lines


def _view(store: Store, job: str, found: DeploymentView, claim: ClaimWatch) -> Group:
    """Returns the deployment's id and times, its table, and what there is to know beyond it."""
    record = found.record
    head, below = f"{job}, begun at {_time(record.created_at_s)}", [found.why]
    if found.job.status in _ENDED:
        now = {robot.name: robot for robot in robots_now(store, found.runs)}
        head += f", as it ended at {_time(record.updated_at_s)}"
        table = deployment_table(found, now=now)
        below += _changed_robots(found.job, now)
    else:
        table = deployment_table(found, command_of(store, job))
        below += [ABANDONED] if claim.is_left() else []
    below += [UNSIGNED_ALARM] if is_unsigned(record) else []
    return Group(Text(head), table, *(Text(terminal_line(line)) for line in below if line))


def _time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, tz=UTC).isoformat(sep=" ", timespec="seconds")
