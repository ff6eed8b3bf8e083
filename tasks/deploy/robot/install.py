"""Installs a bundle on a robot: download, digest and extraction, each safe against a loss of power.

A download continues after it was cut by the network, the store, a kill or a loss of power.
"""

import errno
import logging
import random
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from specs.errors import (
    BundleRefused,
    ObjectNotFound,
    ObjectTooBig,
    StoreDamaged,
    StoreError,
    StoreFull,
    StoreUnreachable,
)
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.disk import Disk, discard
from tasks.deploy.robot.processes import Stop
from tasks.deploy.robot.reported_state import Outage
from tasks.storage.archives import LIMITS, digest_of, install
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.local_files import make_folder, settle_names
from tasks.storage.base.store import Store
from tasks.storage.sealed_bundle import holds_bundle, repack_bundle

MOST_BYTES = LIMITS.total_bytes + (256 << 20)  # of an archive: what it may hold, and headers
_LOG = logging.getLogger(__name__)
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
_DOWNLOAD_PERCENT = 50.0
_SHORTEST_PAUSE_S, _LONGEST_PAUSE_S = 0.2, 10.0
_SLICE_S = 0.5


# The bytes that have arrived stay in the robot's folder, and the next attempt continues from them. The digest at the
# end says whether the file is whole. If it is not, the file is removed and downloaded once more from its beginning.
def download(
    store: Store,
    key: str,
    target: Path,
    digest: str,
    *,
    most_bytes: int | None = None,
    on_block: Callable[[int, int], None] = lambda _done, _size: None,
) -> None:
    """Makes the file hold an object, going on from the bytes that it holds already.

    Args:
        store: Where the object is.
        key: Of the object.
        target: The file.
        digest: The SHA-256 that the object must have.
        most_bytes: More are never written; None for the most that a bundle may have.
        on_block: Called with the bytes that are there and the object's size, for every block.

    Raises:
        ObjectNotFound: There is no object.
        ObjectTooBig: It is bigger than it may be; nothing is left of it here.
        StoreDamaged: It is not the one with the digest; nothing is left of it here.
        StoreFull: This machine has no room; nothing is left of it here.
        StoreError: It was cut; what has arrived is left for the next time.
    """
    most = MOST_BYTES if most_bytes is None else most_bytes
    make_folder(target.parent)
    while True:
        size = store.size(key)
        if size > most:
            raise _too_big(target, f"{store.url}: {key} has {size} bytes", most)
        first = _size_in_store(target)
        _receive(store, key, target, size, on_block)
        if digest_of(target) == digest:
            return
        target.unlink()
        if first == 0:
            raise StoreDamaged(f"{store.url}: {key} is not the one with digest {digest}")


def _size_in_store(target: Path) -> int:
    return target.stat().st_size if target.exists() else 0


def _receive(store: Store, key: str, target: Path, size: int, on_block: Callable[[int, int], None]) -> None:
    # Unpacked it takes the same again. A disk that is filled to the brim would end what runs on it.
    done = _size_in_store(target)
    needed, free = 2 * size - done, shutil.disk_usage(target.parent).free
    if needed > free:
        raise _full(target, f"{needed >> 20} MiB are needed, {free >> 20} MiB are free")
    try:
        with target.open("ab") as file:
            for block in store.blocks(key, done):
                done += len(block)
                if done > size:
                    raise _too_big(target, f"{store.url}: {key} goes on", size)
                file.write(block)
                file.flush()
                on_block(done, size)
    except OSError as exc:
        if exc.errno in _NO_ROOM:
            raise _full(target, str(exc.strerror)) from exc
        raise
    if done < size:
        raise StoreUnreachable(f"{store.url}: {key} ended after {done} of {size} bytes")


def _too_big(target: Path, what: str, most: int) -> ObjectTooBig:
    target.unlink(missing_ok=True)
    return ObjectTooBig(f"{what}, more than the {most} that it may have")


def _full(target: Path, why: str) -> StoreFull:
    target.unlink(missing_ok=True)
    return StoreFull(f"no room for the bundle in {target.parent}: {why}")


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


@dataclass(frozen=True)
class Patience:
    """What goes on while something takes time.

    Attributes:
        stop: Whether the agent may go on.
        meanwhile: Called now and then, so that what runs stays up.
    """

    stop: Stop
    meanwhile: Callable[[], None] = lambda: None

    def tick(self) -> None:
        """Does what has to be done meanwhile.

        Raises:
            StopRequested: The agent has to end.
        """
        self.stop.check()
        self.meanwhile()

    def sleep(self, seconds: float) -> None:
        """Waits.

        Raises:
            StopRequested: The agent has to end.
        """
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0:
            self.tick()
            self.stop.sleep(min(left_s, _SLICE_S))


def fetch_bundle(
    store: Store,
    disk: Disk,
    desired: Desired,
    patience: Patience,
    percent: Callable[[float], None],
    *,
    length_bytes: int | None = None,
) -> None:
    """Makes the desired bundle lie in the robot's versions, and nothing else in its place.

    What lies there is compared with the bundle's digest, and put right from the archive that it was unpacked from, or,
    if that was changed as well, from the store.

    Args:
        store: Where bundles are.
        disk: The robot's folder.
        desired: What the robot shall run.
        patience: What goes on meanwhile.
        percent: Called with how much is done, from 0 to 100.
        length_bytes: Of the bundle, where it was signed.

    Raises:
        StepFailed: The bundle is missing, changed, or too big for this robot, or the store stays away for too long.
        StopRequested: The agent has to end.
    """
    target, archive = disk.version(desired.digest), disk.archive(desired.digest)
    if holds_bundle(target, archive, desired.digest):
        return
    arriving = disk.download(desired.digest)

    def tell(part: float, done: int, size: int) -> None:
        patience.tick()
        percent(part + _DOWNLOAD_PERCENT * done / max(size, 1))

    def bring() -> None:
        key = bundle_key(desired.digest)
        download(store, key, arriving, desired.digest, most_bytes=length_bytes, on_block=partial(tell, 0.0))

    percent(0.0)
    if not archive.is_file() or archive.is_symlink() or digest_of(archive) != desired.digest:
        discard(archive)
        # A robot of before there were archives, or one that has lost its own, runs on while the store is away.
        if repack_bundle(target, archive, desired.digest) and holds_bundle(target, archive, desired.digest):
            percent(100.0)
            return
        retry(bring, desired, patience, progress=lambda: _size(arriving))
        arriving.replace(archive)
        settle_names(archive.parent)
    if target.exists() or target.is_symlink():
        _LOG.warning("%s is not what its digest says, and is unpacked anew", target)
        discard(target)  # once its archive is here: without the store, what lies there stays for its owner to look at
    _unpack(archive, desired.digest, target, partial(tell, _DOWNLOAD_PERCENT))
    percent(100.0)


def retry(
    action: Callable[[], None], desired: Desired, patience: Patience, progress: Callable[[], int] = lambda: 0
) -> None:
    """Does what needs the store, again with growing pauses while the store is away and the robot has time.

    The pauses begin anew when the last attempt got further than the one before.

    Args:
        action: What needs the store.
        desired: Says how much time the robot has.
        patience: What goes on meanwhile.
        progress: Returns how far the attempts have got, such as a number of bytes.

    Raises:
        StepFailed: What was named is not there, is not what it should be, or the time is over.
        StopRequested: The agent has to end.
    """
    until_s, pause_s, reached = time.monotonic() + desired.timeout_s, _SHORTEST_PAUSE_S, progress()
    outage = Outage("get what is to be deployed")
    while True:
        patience.tick()
        try:
            action()
        except (ObjectNotFound, ObjectTooBig, StoreDamaged, StoreFull) as exc:
            raise StepFailed(_code(exc), str(exc)) from exc
        except StoreError as exc:
            if time.monotonic() + pause_s > until_s:
                raise StepFailed("RobotAgentConnectionTimeout", str(exc)) from exc
            outage.failed(exc)
        else:
            outage.worked()
            return
        pause_s = _SHORTEST_PAUSE_S if progress() > reached else pause_s
        reached = progress()
        patience.sleep(pause_s * random.uniform(0.5, 1.5))  # noqa: S311 - jitter, no secret
        pause_s = min(pause_s * 2, _LONGEST_PAUSE_S)


def _unpack(archive: Path, digest: str, target: Path, extracted: Callable[[int, int], None]) -> None:
    try:
        install(archive, digest, target, progress=extracted)
    except BundleRefused as exc:
        raise StepFailed("ExtractingBundleFailure", str(exc)) from exc
    except StoreError as exc:  # this robot's disk is full, or read-only
        raise StepFailed("EnvironmentSetupError", str(exc)) from exc


def _code(exc: StoreError) -> DeploymentJobErrorCode:
    if isinstance(exc, ObjectNotFound):
        return "MissingRobotDeploymentResource"
    return "EnvironmentSetupError" if isinstance(exc, StoreFull) else "EtagMismatch"


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
