"""Rolls one version out to a fleet, wave by wave.

It writes a robot's desired state once for each deployment, and withdraws it if the robot has not answered.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pydantic import JsonValue, TypeAdapter

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ObjectTooBig, StoreError, StoreUnreachable
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.fleet_registry import MOST_BYTES, TOO_BIG, parse_withdrawn, read_desired, read_reported
from tasks.deploy.fleet.states import MOST_SEQUENCE, Desired, RobotProgress, Withdrawn
from tasks.deploy.robot.account import silence_note
from tasks.deploy.rollout.observation import (
    ABORTED,
    RobotWatch,
    count_in_sync,
    phases,
    progress_document,
    recorded_progress,
    rollout_end,
    statuses,
)
from tasks.deploy.rollout.rollout_plan import Move, OperatorCommand, RolloutPlan, next_move
from tasks.deploy.trust.trust_record import Signer
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.claim import Claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read

_LOG = logging.getLogger(__name__)
_KIND = "deployment-job"
COMMAND = "command"
CANCELED = "canceled"
"""The keys of an operator's command in a job's detail (tasks.deploy.rollout.operator_commands)."""
_COMMAND: TypeAdapter[OperatorCommand] = TypeAdapter(OperatorCommand)
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 10.0
_SILENT_S, _NAMED_AT_MOST = 25.0, 5  # an agent looks after 19 s at the latest
_PATIENCE_S = 900.0  # with a store that is away; robots go on meanwhile, and no other controller can take over


# A robot takes a desired state if its sequence is higher than that of the last one. The sequence is the controller's
# time in milliseconds since 1970, or one more than the desired state that lies there, if that is more. The latter
# counts only if the owner's own key has signed it: whoever can write to the store could otherwise use up the numbers.
# What the robot reports never counts. So without a previous state, as when somebody has deleted it, the sequence
# grows with the clock; and with it, a controller whose clock is behind that of the one before it is heard all the
# same.
def ask_robot(
    store: Store,
    desired: Desired,
    sign: Callable[[Desired], Desired] | None = None,
    check: Callable[[], None] = lambda: None,
    own: Callable[[Desired], bool] | None = None,
) -> Desired:
    """Returns the desired state that the robot has for this deployment, written if there was none.

    Asking twice, also after a crash between two robots, asks once: a robot that has a desired state of this deployment
    keeps it, sequence and all. One that is not the owner's own is written over.

    Args:
        store: Where robots look.
        desired: What the robot shall run; its sequence is set here.
        sign: Signs it, or None.
        check: Called directly before the write; raises when this process may not ask any more.
        own: Whether the owner's key has signed a desired state as it stands; None where nothing is signed.

    Raises:
        StoreError: The store fails, or a later epoch of the deployment has asked the robot.
    """
    key = desired_key(desired.robot)
    while True:
        found, etag = read_desired(store, desired.robot)
        before = found if found and found.robot == desired.robot and (own is None or own(found)) else None
        if before and before.deployment == desired.deployment:
            if before.epoch > desired.epoch:
                raise StoreError(f"{store.url}: {key} is of epoch {before.epoch}; this process had {desired.epoch}")
            return before
        asked = before.sequence if before else _withdrawn(store, desired.robot, signed=sign is not None)
        new = desired.model_copy(update={"sequence": _next_sequence(asked, desired.issued_at_s)})
        new = sign(new) if sign else new
        try:
            etag = store.etag(key) if etag == TOO_BIG else etag
            check()
            store.replace(key, encode_document(new), etag) if etag else store.create(key, encode_document(new))
        except (ObjectExists, ObjectConflict, ObjectNotFound):
            continue
        return new


def _next_sequence(asked: int, now_s: float) -> int:
    """Returns the sequence of what is asked now, after what was asked last; 0 for nothing.

    The highest number leaves none for the next: nobody's clock has given it, so it does not count.
    """
    return max(int(now_s * 1000), asked + 1 if asked < MOST_SEQUENCE else 0, 1)


def _withdrawn(store: Store, robot: str, *, signed: bool) -> int:
    """Returns the sequence of what was withdrawn; 0 where things are signed, because that is not."""
    return 0 if signed else withdrawn_sequence(store, robot)


def withdraw_request(store: Store, robot: str, deployment: str, check: Callable[[], None] = lambda: None) -> bool:
    """Returns whether a robot is asked nothing of a deployment any more; one that has answered stays asked.

    The sequence stays behind: a robot that has just read what is withdrawn takes what it is asked next all the same.

    Args:
        store: Where robots look.
        robot: The robot's name.
        deployment: The job's id.
        check: Called directly before the write; raises when this process may not withdraw any more.

    Raises:
        StoreError: The store fails.
    """
    key = desired_key(robot)
    while True:
        before, etag = read_desired(store, robot)
        if before is None or before.deployment != deployment:
            return True
        reported = read_reported(store, robot)
        if reported and reported.deployment == deployment:
            return False
        try:
            check()
            store.replace(key, encode_document(Withdrawn(withdrawn=before.sequence)), etag)
        except (ObjectConflict, ObjectNotFound):
            continue
        return True


def withdrawn_sequence(store: Store, robot: str) -> int:
    """Returns the sequence of what was withdrawn from a robot last; 0 if nothing lies there in its place."""
    try:
        found = parse_withdrawn(store.get(desired_key(robot), MOST_BYTES).body)
    except (ObjectNotFound, ObjectTooBig):
        return 0
    return found.withdrawn if found else 0


# At every tick the controller computes its view from the desired states and the reports of the robots; its memory
# only saves requests. So it may be killed at any moment: the next controller finds which robots were asked, asks none
# of them twice, and forgets none.
#
# Before robots are asked, the job's record announces them, with the epoch of the controller's claim. A controller
# that takes over writes its own epoch into the record first. So a controller that was paused and wakes up can
# announce no robot any more; and its successor has asked the robots that it had announced, so that its writes fail
# because the objects have changed.
def steady_clock() -> Callable[[], float]:
    """Returns a clock of seconds since 1970 that does not jump when the machine's clock is set."""
    ahead_s = time.time() - time.monotonic()
    return lambda: time.monotonic() + ahead_s


@dataclass(frozen=True)
class ControllerPace:
    """How a controller spends its time.

    Attributes:
        poll_s: Seconds between two looks at the robots.
        now_s: The clock, seconds since 1970; one that is set meanwhile must not let robots run out of time.
        sleep: Waits so many seconds.
    """

    poll_s: float = 0.2
    now_s: Callable[[], float] = field(default_factory=steady_clock)
    sleep: Callable[[float], None] = time.sleep


def control_rollout(
    store: Store,
    record: JobRecord,
    plan: RolloutPlan,
    claim: Claim,
    *,
    pace: ControllerPace,
    progress: Callable[[int, int], None],
    signer: Signer | None = None,
) -> JobRecord:
    """Returns the deployment job's record after every robot has ended or was left out.

    Args:
        store: Where robots look.
        record: The job; its detail holds what an earlier controller knew.
        plan: What it does.
        claim: This process's claim on the job, whose epoch stands in the record.
        pace: Clock and poll interval.
        progress: Called with the robots that have ended and robots in all, whenever one ends.
        signer: Signs what a robot is asked, or None.

    Raises:
        StoreError: The store fails or stays away for minutes, or another process has taken the job over.
    """
    controller = _Controller(store, record, plan, claim, pace=pace, progress=progress, signer=signer)
    reached_s, pause_s = time.monotonic(), _FIRST_PAUSE_S
    while True:
        try:
            now = controller.tick()
        except StoreUnreachable as exc:
            if time.monotonic() - reached_s > _PATIENCE_S:
                raise
            _LOG.warning("%s waits for the store: %s", record.id, exc)
            pace.sleep(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            continue
        if is_terminal(now):
            return now
        reached_s, pause_s = time.monotonic(), _FIRST_PAUSE_S
        pace.sleep(pace.poll_s)


class _Controller:
    def __init__(
        self,
        store: Store,
        record: JobRecord,
        plan: RolloutPlan,
        claim: Claim,
        *,
        pace: ControllerPace,
        progress: Callable[[int, int], None],
        signer: Signer | None,
    ) -> None:
        self._store = store
        self._job = record.id
        self._plan = plan
        self._claim = claim
        self._pace = pace
        self._progress = progress
        self._signer = signer
        self._withdrawn = False
        self._silent = set[str]()
        self._known = recorded_progress(record)
        self._watch = RobotWatch(store, plan, record.id, signer.is_own if signer else None)

    def tick(self) -> JobRecord:
        """Returns the record after one look at the robots and what followed from it."""
        self._check_claim()
        record = read(self._store, _KIND, self._job)
        if is_terminal(record):  # another process closed it; robots that were asked go on alone
            return record
        if self._signer:
            self._signer.renew()
        self._ask(self._watch.unasked(self._known))
        seen, move = self._judge(record)
        if move.verdict:
            self._tell(seen)
            end = rollout_end(self._plan, move, seen)
            return self._advance(end.status, seen, end.failure_code, end.failure_reason)
        if statuses(seen) != statuses(self._known):
            record = self._advance("InProgress", seen)
        self._warn_of_silence(seen)
        self._tell(seen)  # after the record: a listener may read it
        self._known = seen
        if not is_terminal(record):
            self._ask(move.start)
        return record

    def _judge(self, record: JobRecord) -> tuple[dict[str, RobotProgress], Move]:
        """Returns how far the robots are, those announced that are to begin now, and what to do."""
        now_s = self._pace.now_s()
        command = _operator_command(record, self._plan, now_s)
        seen = self._watch.look(self._known, now_s)
        if command == "cancel":
            self._withdraw()
            seen |= self._withdraw_silent(seen, now_s)
        move = next_move(phases(seen), self._plan.limits, command)
        if move.verdict:
            seen = self._watch.look(seen, now_s, everyone=True)
            move = next_move(phases(seen), self._plan.limits, command)
        announced = RobotProgress(status="PendingNewDeployment", started_at_s=now_s)
        seen |= dict.fromkeys(move.start, announced) | dict.fromkeys(move.abort, _aborted(now_s))
        return self._watch.with_versions(seen) if move.verdict else seen, move

    def _withdraw(self) -> None:
        """Has robots accept this deployment no more, before the record says that it is canceled."""
        if self._signer and not self._withdrawn:
            self._signer.withdraw(self._job)
            self._withdrawn = True

    def _withdraw_silent(self, seen: Mapping[str, RobotProgress], now_s: float) -> dict[str, RobotProgress]:
        """Returns the robots that had not answered before the cancellation, which are asked nothing any more."""
        silent = [robot for robot, each in seen.items() if each.status == "PendingNewDeployment"]
        taken_back = _aborted(now_s, "the deployment was canceled before this robot answered")
        return {
            robot: taken_back.model_copy(update={"started_at_s": seen[robot].started_at_s})
            for robot in silent
            if withdraw_request(self._store, robot, self._job, self._check_claim)
        }

    def _warn_of_silence(self, seen: Mapping[str, RobotProgress]) -> None:
        """Logs the robots that have not answered for longer than any agent pauses between two looks, each once."""
        before_s = self._pace.now_s() - _SILENT_S
        waiting = (robot for robot, each in seen.items() if each.status == "PendingNewDeployment")
        silent = [robot for robot in waiting if seen[robot].started_at_s < before_s and robot not in self._silent]
        if silent:
            self._silent.update(silent)
            names = ", ".join(silent[:_NAMED_AT_MOST]) + (", ..." if len(silent) > _NAMED_AT_MOST else "")
            note = silence_note(self._store, silent[0])
            why = "start its agent, or see in its log why" + (f"; {note}" if note else "")
            _LOG.warning("no answer for %.0f s from %d robots (%s): %s", _SILENT_S, len(silent), names, why)

    def _tell(self, seen: Mapping[str, RobotProgress]) -> None:
        if count_in_sync(seen) != count_in_sync(self._known):
            self._progress(count_in_sync(seen), len(seen))

    def _ask(self, robots: Sequence[str]) -> None:
        for robot in robots:
            wanted = _desired_state(self._plan, self._job, robot, self._claim.epoch, self._pace.now_s())
            sign, own = (self._signer.sign, self._signer.is_own) if self._signer else (None, None)
            self._watch.remember(ask_robot(self._store, wanted, sign, self._check_claim, own))

    def _check_claim(self) -> None:
        if self._claim.replaced:
            raise StoreError(f"{self._store.url}: another process has taken over deployment {self._job}")
        if self._claim.lost:
            raise StoreUnreachable(f"{self._store.url}: the claim on deployment {self._job} could not be renewed")

    def _advance(
        self,
        status: str,
        seen: Mapping[str, RobotProgress],
        failure_code: DeploymentJobErrorCode | Literal[""] = "",
        failure_reason: str = "",
    ) -> JobRecord:
        detail: dict[str, JsonValue] = {"progress": progress_document(seen)}
        return advance(
            self._store,
            _KIND,
            self._job,
            status,
            failure_code=failure_code,
            failure_reason=failure_reason,
            detail=detail,
            epoch=self._claim.epoch,
        )


def _operator_command(record: JobRecord, plan: RolloutPlan, now_s: float) -> OperatorCommand:
    if CANCELED in record.detail:
        return "cancel"
    if now_s - record.created_at_s > plan.fleet_timeout_s:
        return "time out"
    return _COMMAND.validate_python(record.detail.get(COMMAND, "go"))


def _desired_state(plan: RolloutPlan, deployment: str, robot: str, epoch: int, now_s: float) -> Desired:
    return Desired(
        robot=robot,
        deployment=deployment,
        sequence=1,
        epoch=epoch,
        application=plan.application,
        version=plan.version,
        digest=plan.digest_for(robot) or plan.digest,  # who has none is never asked
        launch=plan.launch,
        environment=plan.environments[robot],
        condition=plan.condition,
        timeout_s=plan.timeout_s,
        issued_at_s=now_s,
    )


def _aborted(now_s: float, reason: str = "the roll-out stopped before this robot's turn") -> RobotProgress:
    return RobotProgress(status="Failed", failure_code=ABORTED, failure_reason=reason, finished_at_s=now_s)
