"""Progress of the robots of a deployment, from their desired states and reports, in few requests; and its end.

The end is a status, a failure code and a reason for the job's record. Who runs what is said in one wording, everywhere.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import PurePosixPath
from typing import Literal

from pydantic import JsonValue, TypeAdapter

from specs.errors import StoreError, StoreUnreachable
from specs.robomaker.bundle import Application
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.fleet_registry import read_desired, read_reported
from tasks.deploy.fleet.states import WAITING, Desired, Reported, RobotProgress, progress_of
from tasks.deploy.rollout.rollout_plan import Move, Phase, RolloutPlan
from tasks.storage.base.keys import application_key, applications_prefix
from tasks.storage.base.store import Store, find_document
from tasks.storage.jobs.records import JobRecord

ABORTED = "RobotDeploymentAborted"
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
# An application that crashes in a loop is given up after eight seconds at the soonest (tasks.deploy.robot.launch).
_FIRST_AGAIN_S = 10.0
_NAMED = 5
_MOST_APPLICATIONS = 200
_KIND = "robot-application"
_DIGEST = re.compile(r"[0-9a-f]{64}")
# The steps after which a robot no longer runs what it ran before.
_CHANGED = frozenset({"ExecutingPreLaunch", "Launching", "ExecutingPostLaunch", "Finished"})
NOTHING = "nothing"
_WHY: Mapping[str, str] = {
    "canary": "a canary failed",
    "time": "the fleet's time was over",
    "canceled": "canceled on request",
}


class VersionNames:
    """Names of the versions that robots run, such as ``courier 1``, by the digests that they report.

    Args:
        store: Where the applications are; each is read once.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._names = dict[str, str]()
        self._read = set[str]()

    def of(self, reported: Reported, asked: Desired | None = None) -> str:
        """Returns what a robot runs, by its last report; ``asked`` is what it is asked for."""
        digest = reported.running_digest
        if not digest:
            return NOTHING
        name = self._name(digest, asked)
        return name if reported.is_up else f"{NOTHING} ({name} cannot be started)"

    def _name(self, digest: str, asked: Desired | None) -> str:
        if asked and digest == asked.digest:
            return f"{asked.application} {asked.version}"
        if digest not in self._names and asked:
            self._learn(asked.application)
        if digest not in self._names:  # it ran another application before
            found = islice(self._store.keys(applications_prefix(_KIND)), _MOST_APPLICATIONS)
            for name in [PurePosixPath(key).stem for key in found]:
                self._learn(name)
        # Whoever wrote the report chose what stands there.
        unnamed = f"bundle {digest[:12]}" if _DIGEST.fullmatch(digest) else "an unknown bundle"
        return self._names.get(digest, unnamed)

    def _learn(self, application: str) -> None:
        if application in self._read:
            return
        self._read.add(application)
        try:
            record = find_document(self._store, application_key(_KIND, application), Application)
        except StoreUnreachable:
            raise
        except StoreError:  # it is damaged: its versions have no names
            return
        for version in record.versions if record else ():
            for digest in (version.digest, *version.digests.values()):
                self._names[digest] = f"{application} {version.number}"


class RobotWatch:
    """Looks at the robots of a deployment; its memory only saves requests.

    Who waits cannot have begun, and who has failed stays so: neither costs a request. Who is in sync may still crash,
    and who did not answer in time may come back: they are looked at again after ten seconds, after twenty, and so on.
    A roll-out that takes ten times as long costs three or four requests more for a robot.

    Args:
        store: Where robots report.
        plan: Which robots, in which order.
        job: The deployment's id.
        own: Whether the owner has signed a desired state; what is not signed counts as not asked. None: all count.
    """

    def __init__(self, store: Store, plan: RolloutPlan, job: str, own: Callable[[Desired], bool] | None = None) -> None:
        self._store = store
        self._plan = plan
        self._job = job
        self._own = own
        self._asked: dict[str, Desired] = {}
        self._again: dict[str, tuple[float, float]] = {}  # when next, and the pause before that
        self._versions = VersionNames(store)

    def remember(self, desired: Desired) -> None:
        """Remembers what a robot was asked."""
        self._asked[desired.robot] = desired

    def unasked(self, known: Mapping[str, RobotProgress]) -> list[str]:
        """Returns the robots that the record announces, and that were not asked before its writer died."""
        return [
            robot for robot, each in known.items() if phase_of(each) is Phase.IN_FLIGHT and not self._desired(robot)
        ]

    def look(
        self, known: Mapping[str, RobotProgress], now_s: float, *, everyone: bool = False
    ) -> dict[str, RobotProgress]:
        """Returns how far each robot of the plan is.

        Args:
            known: How far they were.
            now_s: The controller's clock, seconds since 1970.
            everyone: Whether to look again at all that may have changed, as before a verdict.
        """
        before = {robot: known.get(robot, WAITING) for robot in self._plan.environments}
        return {
            robot: self._look_at(robot, each, now_s) if self._is_due(robot, each, now_s, everyone=everyone) else each
            for robot, each in before.items()
        }

    def _is_due(self, robot: str, known: RobotProgress, now_s: float, *, everyone: bool) -> bool:
        if known.status in {"PendingNewDeployment", "Deploying"}:
            return True
        if known.status not in {"InSync", "NoResponse"}:
            return False
        next_s, pause_s = self._again.setdefault(robot, (now_s + _FIRST_AGAIN_S, _FIRST_AGAIN_S))
        if now_s >= next_s:
            self._again[robot] = (now_s + 2 * pause_s, 2 * pause_s)
        return everyone or now_s >= next_s

    def _look_at(self, robot: str, known: RobotProgress, now_s: float) -> RobotProgress:
        desired = self._desired(robot)
        if desired is None:
            return known
        reported = read_reported(self._store, robot)
        seen = progress_of(desired, reported, now_s=now_s)
        # In sync it has answered; only an answer takes that back.
        if known.status == "InSync" and seen.status != "Failed":
            return known
        return seen.model_copy(update={"runs": self._versions.of(reported, desired) if reported else ""})

    def with_versions(self, seen: Mapping[str, RobotProgress]) -> dict[str, RobotProgress]:
        """Returns the robots with what each runs, also those that were never asked: a request for each of these."""
        return {robot: each if each.runs else self._with_version(robot, each) for robot, each in seen.items()}

    def _with_version(self, robot: str, seen: RobotProgress) -> RobotProgress:
        reported, (asked, _) = read_reported(self._store, robot), read_desired(self._store, robot)
        return seen.model_copy(update={"runs": self._versions.of(reported, asked)}) if reported else seen

    def _desired(self, robot: str) -> Desired | None:
        if robot not in self._asked:
            latest, _ = read_desired(self._store, robot)
            if latest is None or (latest.deployment, latest.robot) != (self._job, robot):
                return None
            if self._own is not None and not self._own(latest):
                return None
            self._asked[robot] = latest
        return self._asked[robot]


def recorded_progress(record: JobRecord) -> dict[str, RobotProgress]:
    """Returns how far each robot was when the job's record was last written."""
    return _PROGRESS.validate_python(record.detail.get("progress", {}))


def live_progress(store: Store, record: JobRecord, now_s: float) -> dict[str, RobotProgress]:
    """Returns how far each robot of a deployment that has not ended is now; nothing before it is planned."""
    if "plan" not in record.detail:
        return {}
    watch = RobotWatch(store, RolloutPlan.model_validate(record.detail["plan"]), record.id)
    return watch.look(recorded_progress(record), now_s)


def progress_document(seen: Mapping[str, RobotProgress]) -> dict[str, JsonValue]:
    """Returns robots' progress as a job's record holds it."""
    return {robot: progress.model_dump(mode="json") for robot, progress in seen.items()}


def phases(seen: Mapping[str, RobotProgress]) -> dict[str, Phase]:
    """Returns where each robot is in the roll-out."""
    return {robot: phase_of(progress) for robot, progress in seen.items()}


def phase_of(progress: RobotProgress) -> Phase:
    """Returns where a robot is in the roll-out."""
    return Phase.ABORTED if progress.failure_code == ABORTED else _PHASES[progress.status]


def count_in_sync(seen: Mapping[str, RobotProgress]) -> int:
    """Returns how many robots run what was asked: what a bar shows as done, so that a failed roll-out fills none."""
    return sum(phase_of(robot) is Phase.IN_SYNC for robot in seen.values())


def statuses(seen: Mapping[str, RobotProgress]) -> dict[str, str]:
    """Returns each robot's status."""
    return {robot: progress.status for robot, progress in seen.items()}


def standing(what: str, seen: Mapping[str, RobotProgress]) -> str:
    """Returns which robots run which version, who went back, and who was never asked.

    Args:
        what: The version that is rolled out, such as ``courier 2``.
        seen: How far the robots are.
    """
    if not seen:
        return f"no robot was asked to run {what}"
    done = [robot for robot, each in seen.items() if phase_of(each) is Phase.IN_SYNC]
    rest = {robot: _runs(each, what) for robot, each in seen.items() if phase_of(each) is not Phase.IN_SYNC}
    named = f" ({', '.join(done)})" if done and rest and len(done) <= _NAMED else ""
    first = f"{len(done)} of {len(seen)} robots {_verb(len(done))} {what}{named}"
    known = Counter(runs for robot, runs in rest.items() if runs and seen[robot].status != "NoResponse")
    counts = sorted(known.items(), key=lambda each: (-each[1], each[0]))
    others = [f"{count} {_verb(count)} {runs}" for runs, count in counts]
    fates = dict[str, list[str]]()
    for robot, runs in rest.items():
        fates.setdefault(_fate(seen[robot], runs), []).append(robot)
    return "; ".join([", ".join([first, *others]), *(f"{fate}: {_names(robots)}" for fate, robots in fates.items())])


def _verb(robots: int) -> str:
    return "runs" if robots == 1 else "run"


def _names(robots: Iterable[str]) -> str:
    shown = list(islice(robots, _NAMED + 1))
    return ", ".join([*shown[:_NAMED], *(["..."] if len(shown) > _NAMED else [])])


def _runs(robot: RobotProgress, what: str) -> str:
    return f"{what} as before" if robot.runs == what else robot.runs


def _fate(robot: RobotProgress, runs: str) -> str:
    """Returns what became of a robot that does not run what is rolled out."""
    left = f", left on {runs}" if runs else ""
    if not robot.started_at_s:
        return "not asked yet" if phase_of(robot) is Phase.WAITING else f"never asked{left}"
    if phase_of(robot) is Phase.IN_FLIGHT:
        return "under way"
    if robot.status == "NoResponse":
        return "no answer in time, will take it when back" + (f" (last on {runs})" if runs else "")
    if phase_of(robot) is Phase.ABORTED:
        return f"asked no more{left}"
    if robot.step in _CHANGED and runs:
        return f"failed, left with {runs}" if runs.startswith(NOTHING) else f"went back to {runs}"
    return f"failed{left}"


def rollout_standing(record: JobRecord, seen: Mapping[str, RobotProgress]) -> tuple[str, str]:
    """Returns a deployment in words: who runs what, and what stopped it, or an empty text.

    Args:
        record: The job.
        seen: How far its robots are.
    """
    plan = record.detail.get("plan")
    what = f"{plan.get('application')} {plan.get('version')}" if isinstance(plan, dict) else "a version"
    text = standing(what, seen)
    why = record.failure_reason.removeprefix(text).removeprefix("; ")
    return text, ": ".join(filter(None, (record.failure_code, why)))


@dataclass(frozen=True)
class RolloutEnd:
    """Attributes: status, failure_code, failure_reason: As RoboMaker has them; empty for a success."""

    status: str
    failure_code: DeploymentJobErrorCode | Literal[""] = ""
    failure_reason: str = ""


def rollout_end(plan: RolloutPlan, move: Move, seen: Mapping[str, RobotProgress]) -> RolloutEnd:
    """Returns how a roll-out ended.

    Args:
        plan: What it was to do.
        move: The last one, which has a verdict.
        seen: How far the robots are.
    """
    if move.verdict == "Succeeded":
        return RolloutEnd("Succeeded")
    now = standing(f"{plan.application} {plan.version}", seen)
    if move.verdict == "Canceled":
        return RolloutEnd("Canceled", failure_reason=f"{now}; {_WHY['canceled']}")
    code: DeploymentJobErrorCode = "FleetDeploymentTimeout" if move.why == "time" else "FailureThresholdBreached"
    return RolloutEnd("Failed", code, f"{now}; {_failures(plan, move, seen)}")


def _failures(plan: RolloutPlan, move: Move, seen: Mapping[str, RobotProgress]) -> str:
    failed = {robot: each for robot, each in seen.items() if phase_of(each) is Phase.FAILED}
    names = ", ".join(f"{robot}: {each.failure_code}" for robot, each in list(failed.items())[:_NAMED])
    why = next((f"; {robot}: {each.failure_reason}" for robot, each in failed.items() if each.failure_reason), "")
    what = f"{len(failed)} of {len(seen)} robots failed" + (f" ({names})" if names else "")
    if move.why in _WHY:
        return f"{_WHY[move.why]}; {what}{why}"
    return f"{what}, and {plan.failures} stop the roll-out{why}"
