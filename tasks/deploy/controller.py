"""Rolls one version out to a fleet, wave by wave.

What the controller believes is computed at every tick from what robots were asked and what they report; its memory only
saves requests. So it may be killed at any moment: the next one finds who was asked, asks nobody twice, forgets nobody.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pydantic import JsonValue, TypeAdapter

from specs.base import Spec
from specs.common import S3Object
from specs.deployment import DeploymentLaunchConfig
from specs.errors import StoreError
from tasks.deploy.robots import ask, read_desired, read_reported
from tasks.deploy.rollout import Limits, Move, Phase, Wish, next_move
from tasks.deploy.states import WAITING, Desired, RobotProgress, progress_of
from tasks.storage.claim import Claim
from tasks.storage.records import JobRecord, advance, is_terminal, read
from tasks.storage.store import Store

_LOG = logging.getLogger(__name__)
_KIND = "deployment-job"
WISH = "wish"
CANCELED = "canceled"
"""Where a job's detail says what somebody wants of it (tasks.deploy.steering)."""
_WISH: TypeAdapter[Wish] = TypeAdapter(Wish)
_PROGRESS = TypeAdapter(dict[str, RobotProgress])
_PHASES: Mapping[str, Phase] = {
    "Available": Phase.WAITING,
    "Registered": Phase.WAITING,
    "PendingNewDeployment": Phase.IN_FLIGHT,
    "Deploying": Phase.IN_FLIGHT,
    "InSync": Phase.IN_SYNC,
    "Failed": Phase.FAILED,
    "NoResponse": Phase.FAILED,
}
ABORTED = "RobotDeploymentAborted"
FLEET_TIMEOUT_S = 30 * 86_400.0  # semantics 8
_WHY: Mapping[str, str] = {
    "canary": "a canary failed",
    "time": "the fleet's time was over",
    "canceled": "canceled on request",
}


class Plan(Spec):
    """What a deployment job does; written into its record before the first robot is asked, and the same ever after.

    Attributes:
        environments: The robots in the order in which they are asked, each with the variables its application gets.
        at_once: How many robots may be in flight.
        failures: How many failures stop the roll-out.
        timeout_s: How long one robot may take.
        canaries: How many robots must be in sync before any other is asked.
        least_ended: How many robots must have ended before failures stop the roll-out.
        fleet_timeout_s: How long the fleet may take.
    """

    fleet: str
    application: str
    version: int
    digest: str
    launch: DeploymentLaunchConfig
    environments: dict[str, dict[str, str]]
    condition: S3Object | None = None
    at_once: int
    failures: int
    timeout_s: float
    canaries: int = 0
    least_ended: int = 0
    fleet_timeout_s: float = FLEET_TIMEOUT_S

    @property
    def limits(self) -> Limits:
        """Returns the roll-out's bounds."""
        return Limits(self.at_once, self.failures, self.canaries, self.least_ended)


@dataclass(frozen=True)
class Pace:
    """How a controller spends its time.

    Attributes:
        poll_s: Seconds between two looks at the robots.
        now_s: The clock, seconds since 1970.
        sleep: Waits so many seconds.
    """

    poll_s: float = 0.2
    now_s: Callable[[], float] = time.time
    sleep: Callable[[float], None] = time.sleep


def roll_out(
    store: Store,
    record: JobRecord,
    plan: Plan,
    claim: Claim,
    *,
    pace: Pace,
    progress: Callable[[int, int], None],
    sign: Callable[[Desired], Desired] | None = None,
) -> JobRecord:
    """Returns the deployment job's record after every robot has ended or was left out.

    Args:
        store: Where robots look.
        record: The job; its detail holds what an earlier controller knew.
        plan: What it does.
        claim: This process's claim on the job.
        pace: Clock and poll interval.
        progress: Called with the robots that have ended and robots in all, whenever one ends.
        sign: Signs what a robot is asked, or None.

    Raises:
        StoreError: The store fails, or another process has taken the job over.
    """
    known = recorded_progress(record)
    asked = _asked_before(store, plan, record.id)
    while True:
        now = _still_ours(store, record.id, claim)
        if is_terminal(now):  # somebody closed it: whoever was asked is on its own
            return now
        seen = _observe(store, plan, asked, known, pace.now_s())
        move = next_move(_phases(seen), plan.limits, _wish(now, plan, pace.now_s()))
        for robot in move.start:
            wanted = _wanted(plan, record.id, robot, claim.epoch, pace.now_s())
            asked[robot] = ask(store, wanted, sign)
        seen |= {robot: _aborted(pace.now_s()) for robot in move.abort}
        changed = _statuses(seen) != _statuses(known)
        if _ended(seen) != _ended(known):
            progress(_ended(seen), len(seen))
        if move.verdict:
            return _conclude(store, record, plan, move, seen)
        if changed:
            advance(store, _KIND, record.id, "InProgress", detail={"progress": _dumped(seen)})
        known = seen
        if not move.start:
            pace.sleep(pace.poll_s)


def _still_ours(store: Store, job: str, claim: Claim) -> JobRecord:
    if claim.lost:
        raise StoreError(f"{store.url}: another process has taken over deployment {job}")
    return read(store, _KIND, job)


def _wish(record: JobRecord, plan: Plan, now_s: float) -> Wish:
    if CANCELED in record.detail:
        return "cancel"
    if now_s - record.created_at_s > plan.fleet_timeout_s:
        return "time out"
    return _WISH.validate_python(record.detail.get(WISH, "go"))


def _asked_before(store: Store, plan: Plan, deployment: str) -> dict[str, Desired]:
    """Returns what robots were asked already by an earlier controller of this deployment."""
    latest = ((robot, read_desired(store, robot)[0]) for robot in plan.environments)
    return {robot: desired for robot, desired in latest if desired and desired.deployment == deployment}


def _observe(
    store: Store, plan: Plan, asked: Mapping[str, Desired], known: Mapping[str, RobotProgress], now_s: float
) -> dict[str, RobotProgress]:
    """Returns how far each robot of the plan is.

    Who was not asked cannot have begun, and who is known to have ended stays so; only the others cost a request. One
    that did not answer in time is among them: it may have come back.
    """
    seen: dict[str, RobotProgress] = {}
    for robot in plan.environments:
        desired, before = asked.get(robot), known.get(robot, WAITING)
        if desired is None or before.status in {"InSync", "Failed"}:
            seen[robot] = before
        else:
            seen[robot] = progress_of(desired, read_reported(store, robot), now_s=now_s)
    return seen


def recorded_progress(record: JobRecord) -> dict[str, RobotProgress]:
    """Returns how far each robot was when the job's record was last written."""
    return _PROGRESS.validate_python(record.detail.get("progress", {}))


def live_progress(store: Store, record: JobRecord, now_s: float) -> dict[str, RobotProgress]:
    """Returns how far each robot of a deployment that has not ended is now; nothing before it is planned."""
    if "plan" not in record.detail:
        return {}
    plan = Plan.model_validate(record.detail["plan"])
    return _observe(store, plan, _asked_before(store, plan, record.id), recorded_progress(record), now_s)


def _wanted(plan: Plan, deployment: str, robot: str, epoch: int, now_s: float) -> Desired:
    return Desired(
        robot=robot,
        deployment=deployment,
        sequence=1,
        epoch=epoch,
        application=plan.application,
        version=plan.version,
        digest=plan.digest,
        launch=plan.launch,
        environment=plan.environments[robot],
        condition=plan.condition,
        timeout_s=plan.timeout_s,
        issued_at_s=now_s,
    )


def _conclude(store: Store, record: JobRecord, plan: Plan, move: Move, seen: Mapping[str, RobotProgress]) -> JobRecord:
    detail: dict[str, JsonValue] = {"progress": _dumped(seen)}
    if move.verdict == "Succeeded":
        return advance(store, _KIND, record.id, "Succeeded", detail=detail)
    if move.verdict == "Canceled":
        return advance(
            store, _KIND, record.id, "Canceled", failure_reason=_left_out(_WHY["canceled"], seen), detail=detail
        )
    code = "FleetDeploymentTimeout" if move.why == "time" else "FailureThresholdBreached"
    reason = _left_out(_failures(plan, move, seen), seen)
    return advance(store, _KIND, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def _failures(plan: Plan, move: Move, seen: Mapping[str, RobotProgress]) -> str:
    failed = {robot: each.failure_code for robot, each in seen.items() if _phase(each) is Phase.FAILED}
    names = ", ".join(f"{robot}: {code}" for robot, code in list(failed.items())[:5])
    what = f"{len(failed)} of {len(seen)} robots failed" + (f" ({names})" if names else "")
    if move.why in _WHY:
        return f"{_WHY[move.why]}; {what}"
    return f"{what}, and {plan.failures} stop the roll-out"


def _left_out(reason: str, seen: Mapping[str, RobotProgress]) -> str:
    aborted = sum(_phase(each) is Phase.ABORTED for each in seen.values())
    return reason + (f"; {aborted} were left as they were" if aborted else "")


def _aborted(now_s: float) -> RobotProgress:
    reason = "the roll-out stopped before this robot's turn"
    return RobotProgress(status="Failed", failure_code=ABORTED, failure_reason=reason, finished_at_s=now_s)


def _phases(seen: Mapping[str, RobotProgress]) -> dict[str, Phase]:
    return {robot: _phase(progress) for robot, progress in seen.items()}


def _phase(progress: RobotProgress) -> Phase:
    return Phase.ABORTED if progress.failure_code == ABORTED else _PHASES[progress.status]


def _ended(seen: Mapping[str, RobotProgress]) -> int:
    return sum(_phase(robot) not in {Phase.WAITING, Phase.IN_FLIGHT} for robot in seen.values())


def _statuses(seen: Mapping[str, RobotProgress]) -> dict[str, str]:
    return {robot: progress.status for robot, progress in seen.items()}


def _dumped(seen: Mapping[str, RobotProgress]) -> dict[str, JsonValue]:
    return {robot: progress.model_dump(mode="json") for robot, progress in seen.items()}
