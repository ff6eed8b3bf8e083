"""One robot's update, step by step, and its return to the old version (docs/reference/robomaker.md, section 8).

Before the download a condition is asked: a script of the owner's that decides on each robot whether it downloads.
"""

import hashlib
import logging
import time
from collections.abc import Callable
from uuid import uuid4

from specs.errors import DocumentError, StoreError, TrustExpired, TrustRefused
from specs.field_types import S3Object
from specs.robomaker.deployment import RobotDeploymentStep
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.states import MOST_CONDITION_BYTES, Desired, Reported
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.install import Patience, StepFailed, fetch_bundle, retry
from tasks.deploy.robot.launch import (
    CrashLoop,
    LaunchPlace,
    RunningApplication,
    check_bundle,
    check_launch,
    run_program,
    run_script,
)
from tasks.deploy.robot.processes import StopRequested, end_all, reap_orphans
from tasks.deploy.robot.reported_state import REASON_CHARACTERS, Attempt, Reporter, one_line
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket

_LOG = logging.getLogger(__name__)
_RESTORE_AGAIN_S = 30.0
Check = Callable[[Desired], int]
"""Returns how long the bundle is that the keys vouch for, or raises TrustRefused."""


def ask_condition(store: Store, place: LaunchPlace, desired: Desired, condition: S3Object, patience: Patience) -> None:
    """Runs the condition; returns when it allows the download.

    Args:
        store: Where buckets are.
        place: Where programs run.
        desired: What the robot shall run.
        condition: The script.
        patience: What goes on meanwhile.

    Raises:
        StepFailed: It exits with another code than 0, is not there, or is not the one with the ETag.
        StopRequested: The agent has to end.
    """
    script = place.disk.downloads / f"{desired.sequence:06d}-condition"

    def download() -> None:
        stored = open_bucket(store, condition.bucket).get(condition.key, MOST_CONDITION_BYTES)
        if condition.etag and condition.etag.strip('"') != stored.etag.strip('"'):
            raise StepFailed("EtagMismatch", f"{condition.key} has ETag {stored.etag}, not {condition.etag}")
        if desired.condition_sha256 not in {"", hashlib.sha256(stored.body).hexdigest()}:
            raise StepFailed("EtagMismatch", f"{condition.key} was changed after the deployment was signed")
        script.write_bytes(stored.body)

    try:
        retry(download, desired, patience)
    except DocumentError as exc:
        raise StepFailed("DownloadConditionFailed", str(exc)) from exc
    script.chmod(0o755)  # for the account that programs run under
    try:
        run_program(place, desired, script, "condition", "DownloadConditionFailed")
    finally:
        script.unlink()


# The robot's state is written before each thing that cannot be undone: what is accepted, then what runs. Whatever is
# cut short is begun again from the first step at the next start; each step finds what the last attempt finished.
# RoboMaker stops the old application before the download; here it runs until the first script, so that a slow network
# costs no uptime.
class RobotUpdater:
    """One robot: its folder, its application, and its reports to the store.

    Args:
        store: Where bundles are.
        place: Where programs run.
        reporter: Whom to tell.
        check: Refuses what the keys do not vouch for; None for a robot that does what it finds.
    """

    def __init__(self, store: Store, place: LaunchPlace, reporter: Reporter, check: Check | None = None) -> None:
        self._store = store
        self._check = check
        self._place = place
        self._disk: Disk = place.disk
        self._reporter = reporter
        self._state = self._disk.load()
        self._application: RunningApplication | None = None
        self._owes_state = False
        self._restore_at_s = 0.0
        self._expired: Desired | None = None
        self._patience = Patience(place.stop, self._keep_up)
        self._boot_id = uuid4().hex[:12]

    def recover(self) -> None:
        """Takes up what the last agent on this folder left: ends its processes, repairs the links, finishes its work.

        Raises:
            StopRequested: The agent has to end.
        """
        end_all(self._disk.root)
        missed = ""
        if self._state.outcome or self._state.target:  # else nothing is known, and nothing is taken away
            missed = self._restore()
        if self._state.target and self._is_still_wanted(self._state.target):
            self._deploy(self._state.target)
        elif self._state.outcome:
            self._note_up(is_up=not missed)
            self._reporter.tell(self._state.outcome)

    def accept(self, desired: Desired) -> bool:
        """Deploys what is asked for, unless it was accepted before, or is older than what was.

        Returns:
            Whether that was the last word. Else it is to be asked again: what was signed has expired by this robot's
            clock, which may be wrong after a start, or the owner may renew it.

        Raises:
            StopRequested: The agent has to end.
            StoreError: The store is away; nothing was accepted or refused yet.
        """
        if desired.robot != self._place.robot or self._is_old(desired):
            asked = (desired.deployment, desired.robot, desired.sequence, desired.epoch)
            _LOG.warning("refused %s for %s: sequence %d, epoch %d", *asked)
        elif desired.sequence > self._state.sequence:
            try:
                accepted = self._try_accept(desired)
            except TrustExpired as exc:
                self._refuse_for_now(desired, exc)
                return False
            if accepted:
                self._deploy(desired)
        return True

    def supervise(self) -> None:
        """Keeps the application up, and sends a report that waits; returns at once."""
        self._reporter.flush()
        reap_orphans()
        if self._owes_state:
            self._save()
        try:
            if self._application:
                self._application.supervise()
            elif self._state.running and time.monotonic() >= self._restore_at_s:
                self._note_up(is_up=not self._restore())
            if self._application and self._application.has_settled:
                self._note_up(is_up=True)
        except StepFailed as exc:
            _LOG.warning("cannot start the application again: %s", exc)
            self._note_up(is_up=False)
        except CrashLoop as exc:
            _LOG.warning("%s", exc)
            self._go_back_for_good(str(exc))

    def _note_up(self, *, is_up: bool) -> None:
        """Reports whether what the robot is said to run does run, if that has changed."""
        outcome = self._state.outcome
        if outcome and outcome.is_up != is_up:
            changed = outcome.model_copy(update={"is_up": is_up})
            self._save(outcome=changed)
            self._reporter.tell(changed)

    def end(self) -> None:
        """Ends the application and everything that was ever started in this folder."""
        self._end_application()
        end_all(self._disk.root)

    def _is_old(self, desired: Desired) -> bool:
        """Returns whether it comes from before what was accepted last, or from a controller that was replaced since."""
        again = desired.deployment == self._state.deployment
        return desired.sequence < self._state.sequence or (again and desired.epoch < self._state.epoch)

    def _is_still_wanted(self, desired: Desired) -> bool:
        """Returns whether the keys still vouch for what was accepted before the agent ended, which may be long ago.

        While the store is away, what they said at that time counts. What has expired by this robot's clock is given up,
        and taken again if another look finds it good.
        """
        try:
            if self._check:
                self._check(desired)
        except TrustRefused as exc:
            _LOG.warning("gave up %s: %s", desired.deployment, exc)
            outcome = self._attempt(desired).failed("BadPermissionError", f"refused: {exc}")
            self._save(target=None, outcome=outcome)
            if isinstance(exc, TrustExpired):
                self._expired = desired
                self._save(sequence=desired.sequence - 1)
            return False
        except StoreError as exc:
            _LOG.warning("goes on with %s unasked: %s", desired.deployment, exc)
        except StopRequested:
            raise
        except Exception as exc:  # noqa: BLE001 - metadata is anybody's: else the agent would end at each start
            _LOG.warning("goes on with %s unasked: %s", desired.deployment, one_line(f"{type(exc).__name__}: {exc}"))
        return True

    def _try_accept(self, desired: Desired) -> bool:
        """Accepts and keeps a desired state, or reports why not; returns whether it was accepted.

        What has expired is raised: another look may find it good.

        The sequence of a state that is not signed is not kept: anybody who can write to the store could make the robot
        deaf with a high one. Whatever goes wrong while it is looked at is a refusal: what runs, runs on.
        """
        accepted = {"sequence": desired.sequence, "deployment": desired.deployment, "epoch": desired.epoch}
        try:
            length_bytes = self._check(desired) if self._check else None
            changed = self._state.model_copy(update={**accepted, "target": desired, "length_bytes": length_bytes})
            self._disk.save(changed)
        except TrustExpired:
            raise
        except TrustRefused as exc:
            self._refuse(desired, "BadPermissionError", f"refused: {exc}")
            return False
        except OSError as exc:
            self._refuse(desired, "EnvironmentSetupError", f"this robot cannot write to its disk: {exc}")
            return False
        except (StoreError, StopRequested):
            raise
        except Exception as exc:  # noqa: BLE001 - who writes to the store chooses what is parsed here
            _LOG.exception("cannot look at %s", desired.deployment)
            self._refuse(desired, "BadPermissionError", f"refused: it cannot be verified: {type(exc).__name__}: {exc}")
            return False
        self._state = changed
        if self._check is None:
            _LOG.warning("UNSIGNED: %s runs %s, which nobody's key vouches for", desired.robot, desired.digest[:12])
        return True

    def _refuse_for_now(self, desired: Desired, exc: TrustExpired) -> None:
        """Reports once that it has expired, however often it is asked again."""
        if self._expired != desired:
            self._refuse(desired, "BadPermissionError", f"refused: {exc}")
        self._expired = desired

    def _refuse(self, desired: Desired, code: DeploymentJobErrorCode, reason: str) -> None:
        _LOG.warning("refused %s: %s", desired.deployment, one_line(reason))
        self._reporter.tell(self._attempt(desired).failed(code, reason))

    def _attempt(self, desired: Desired) -> Attempt:
        running = self._state.running
        return Attempt(self._reporter, desired, self._boot_id, running.digest if running else "")

    def _deploy(self, desired: Desired) -> None:
        running = self._state.running
        attempt = self._attempt(desired)
        try:
            self._try(desired, attempt)
        except StepFailed as exc:
            _LOG.warning("%s failed: %s", desired.deployment, one_line(str(exc)))
            outcome = attempt.failed(exc.code, exc.reason)
            # First that it failed, so that it is not tried again after a loss of power; then the way back.
            self._save(target=None, outcome=outcome)
            outcome = self._left_with(outcome, self._go_back())
        else:
            outcome = attempt.succeeded(desired.digest)
            same = running and running.digest == desired.digest
            previous = self._state.previous if same else running
            self._save(target=None, running=desired, previous=previous, outcome=outcome)
            self._keep_versions()
        self._reporter.tell(outcome)

    def _try(self, desired: Desired, attempt: Attempt) -> None:
        """Goes through the steps; what nobody foresaw fails the deployment, or it would end the agent at each start."""
        try:
            self._go_through(desired, attempt)
        except (StepFailed, StopRequested):
            raise
        except OSError as exc:  # the disk is full, or read-only, or broken
            raise StepFailed("EnvironmentSetupError", f"this robot cannot write to its disk: {exc}") from exc
        except Exception as exc:
            _LOG.exception("%s failed in an unexpected way", desired.deployment)
            raise StepFailed("EnvironmentSetupError", f"unexpected: {type(exc).__name__}: {exc}") from exc

    def _go_through(self, desired: Desired, attempt: Attempt) -> None:
        launch = desired.launch
        self._begin(attempt, "Validating")
        check_launch(desired)
        if desired.condition:
            self._begin(attempt, "ExecutingDownloadCondition")
            ask_condition(self._store, self._place, desired, desired.condition, self._patience)
        self._begin(attempt, "DownloadingExtracting")
        length_bytes = self._state.length_bytes
        fetch_bundle(self._store, self._disk, desired, self._patience, attempt.percent, length_bytes=length_bytes)
        check_bundle(self._place, desired)  # what runs goes on until this one can
        self._begin(attempt, "ExecutingPreLaunch")
        self._end_application()
        if launch.preLaunchFile:
            run_script(self._place, desired, launch.preLaunchFile, "pre-launch", "PreLaunchFileFailure")
        self._begin(attempt, "Launching")
        self._disk.switch(desired.digest)
        self._application = RunningApplication(self._place, desired, self._bring)
        self._application.wait_until_up()
        self._begin(attempt, "ExecutingPostLaunch")
        if launch.postLaunchFile:
            run_script(self._place, desired, launch.postLaunchFile, "post-launch", "PostLaunchFileFailure")

    def _bring(self, desired: Desired) -> None:
        """Makes sure that nothing runs but what the digest says.

        A store that is away is asked once: whoever launches comes again, and the agent does not stand still meanwhile.
        """
        once = desired.model_copy(update={"timeout_s": 0.0})
        try:
            fetch_bundle(self._store, self._disk, once, Patience(self._place.stop), lambda _percent: None)
        except OSError as exc:  # what the store cannot do is another error: it would end the agent
            raise StepFailed("EnvironmentSetupError", f"this robot's disk: {exc}") from exc

    def _keep_up(self) -> None:
        """Keeps up what runs while another version is brought, which will replace it whether it crashes or not."""
        try:
            if self._application:
                self._application.supervise()
        except (StepFailed, CrashLoop) as exc:
            _LOG.warning("%s", exc)

    def _begin(self, attempt: Attempt, step: RobotDeploymentStep) -> None:
        self._place.stop.check()
        attempt.at(step)

    def _go_back(self) -> str:
        """Returns why what ran before does not run again; an empty text if it does, or nothing ran."""
        if self._application and self._application.desired != self._state.running:
            self._end_application()
        return self._restore()

    def _left_with(self, outcome: Reported, missed: str) -> Reported:
        """Returns the report of a failure, kept, with why the robot has not gone back to what ran before, if so."""
        running = self._state.running
        lacking = "" if running else "there is no version to go back to"
        left = f"cannot go back to version {running.version}: {missed}" if running and missed else lacking
        if not left:
            return outcome
        reason = f"{outcome.failure_reason[: REASON_CHARACTERS // 2]}; {one_line(left)}"[:REASON_CHARACTERS]
        told = outcome.model_copy(update={"failure_reason": reason, "is_up": running is None})
        self._save(outcome=told)
        return told

    def _go_back_for_good(self, why: str) -> None:
        """Returns from a version that does not stay up to the one before it, and reports that; without one, tries on.

        The status changes from InSync to Failed, so that the fleet does not show a version that does not run.
        """
        running, previous, outcome = self._state.running, self._state.previous, self._state.outcome
        if not (running and outcome):
            return
        change: dict[str, object] = {"status": "Failed", "failure_code": "EnvironmentSetupError"}
        change |= {"finished_at_s": time.time()}
        if not previous or previous.digest == running.digest:
            if outcome.is_up:
                reason = one_line(f"{why}; there is no version to go back to: it is tried again and again")
                failed = outcome.model_copy(update={**change, "failure_reason": reason, "is_up": False})
                self._save(outcome=failed)
                self._reporter.tell(failed)
            return
        reason = one_line(f"{why}; went back to version {previous.version}")
        failed = outcome.model_copy(
            update={**change, "failure_reason": reason, "running_digest": previous.digest, "is_up": True}
        )
        self._end_application()
        self._save(running=previous, previous=None, outcome=failed)
        self._reporter.tell(self._left_with(failed, self._restore()))

    def _restore(self) -> str:
        """Makes the links show what runs, and runs it; returns why that is not possible, or an empty text."""
        running = self._state.running
        self._disk.switch(running.digest if running else None)
        self._keep_versions()
        if running and self._application is None:
            try:
                self._application = RunningApplication(self._place, running, self._bring)
            except StepFailed as exc:
                _LOG.error("cannot start what ran before: %s", exc)
                self._restore_at_s = time.monotonic() + _RESTORE_AGAIN_S
                return exc.reason
        return ""

    def _keep_versions(self) -> None:
        self._disk.remember(self._state.previous.digest if self._state.previous else None)
        self._disk.tidy(self._state)

    def _end_application(self) -> None:
        if self._application:
            self._application.end()
        self._application = None

    def _save(self, **changes: object) -> None:
        """Keeps what has happened; on a disk that is full, in memory, and on the disk as soon as that is possible."""
        self._state = self._state.model_copy(update=changes)
        try:
            self._disk.save(self._state)
        except OSError as exc:
            if not self._owes_state:
                _LOG.error("cannot keep this robot's state: %s", exc)
            self._owes_state = True
        else:
            self._owes_state = False
