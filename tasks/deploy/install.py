"""Brings a bundle onto a robot: download, digest, extraction, each able to be cut short by a loss of power."""

import logging
import random
import time
from collections.abc import Callable

from specs.deployment import DeploymentJobErrorCode
from specs.errors import BundleRefused, ObjectNotFound, StoreError
from tasks.deploy.disk import Disk
from tasks.deploy.states import Desired
from tasks.deploy.stopping import Stop
from tasks.storage.archives import digest_of, install
from tasks.storage.keys import bundle_key
from tasks.storage.store import Store

_LOG = logging.getLogger(__name__)
_DOWNLOAD_PERCENT = 50.0
_LONGEST_PAUSE_S = 10.0


class StepFailed(Exception):  # noqa: N818 - a state, as RoboMaker names it
    """A step of a deployment failed on this robot; it returns to what ran before.

    Attributes:
        code: RoboMaker's.
        reason: What happened, for a person.
    """

    def __init__(self, code: DeploymentJobErrorCode, reason: str) -> None:
        self.code: DeploymentJobErrorCode = code
        self.reason = reason
        super().__init__(f"{code}: {reason}")


def fetch(store: Store, disk: Disk, desired: Desired, stop: Stop, percent: Callable[[float], None]) -> None:
    """Makes the desired bundle lie in the robot's versions; does nothing when it does already.

    Args:
        store: Where bundles are.
        disk: The robot's folder.
        desired: What the robot shall run.
        stop: Whether the agent may go on.
        percent: Called with how much is done, from 0 to 100.

    Raises:
        StepFailed: There is no such bundle, it is not what was published, or the store stays away for too long.
        StopRequested: The agent has to end.
    """
    target = disk.version(desired.digest)
    if target.is_dir():
        return
    archive = disk.downloads / f"{desired.digest}.tar"
    percent(0.0)
    retried(lambda: store.download(bundle_key(desired.digest), archive), desired, stop)
    percent(_DOWNLOAD_PERCENT)
    if digest_of(archive) != desired.digest:
        archive.unlink()
        raise StepFailed("EtagMismatch", f"the bundle in the store is not the one with digest {desired.digest}")

    def extracted(done: int, total: int) -> None:
        stop.check()
        percent(_DOWNLOAD_PERCENT + (100.0 - _DOWNLOAD_PERCENT) * done / max(total, 1))

    try:
        install(archive, desired.digest, target, progress=extracted)
    except BundleRefused as exc:
        raise StepFailed("ExtractingBundleFailure", str(exc)) from exc
    finally:
        archive.unlink(missing_ok=True)
    percent(100.0)


def retried(action: Callable[[], None], desired: Desired, stop: Stop) -> None:
    """Does what needs the store, again with growing pauses while the store is away and the robot has time.

    Raises:
        StepFailed: What was named is not there, or the time is over.
        StopRequested: The agent has to end.
    """
    until_s, pause_s = time.monotonic() + desired.timeout_s, 0.2
    while True:
        stop.check()
        try:
            action()
        except ObjectNotFound as exc:
            raise StepFailed("MissingRobotDeploymentResource", str(exc)) from exc
        except StoreError as exc:
            if time.monotonic() + pause_s > until_s:
                raise StepFailed("RobotAgentConnectionTimeout", str(exc)) from exc
            _LOG.warning("the store is away: %s", exc)
        else:
            return
        stop.sleep(pause_s * random.uniform(0.5, 1.5))  # noqa: S311 - jitter, no secret
        pause_s = min(pause_s * 2, _LONGEST_PAUSE_S)
