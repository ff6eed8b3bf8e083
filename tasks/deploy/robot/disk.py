"""A robot's folder: its state, its versions and its lock, all safe against a power cut.

agent.lock             held by the one agent that works here
state.json             which sequence was accepted, what runs, what ran before, how the last deployment ended
sequence               the sequence once more, for an agent that cannot read state.json
versions/<digest>/     installed bundles, complete or absent
archives/<digest>      what they were unpacked from, and are compared with before each launch
current, previous      links into versions; replaced in one step, so never broken
downloads/ logs/       what has arrived of a bundle so far, and other files that may go

The agent that holds the lock alone may start programs in the folder, and end them.
"""

import fcntl
import logging
import os
import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from pydantic import ValidationError

from specs.base import Spec
from tasks.deploy.fleet.states import Desired, Reported
from tasks.storage.base.local_files import make_folder, settle_names, whole_file
from tasks.storage.image_files import ImageFolders, image_root

_LOG = logging.getLogger(__name__)
LOCK = "agent.lock"
_SEQUENCE, _PARTIAL = "sequence", ".part"


class RobotState(Spec):
    """What a robot remembers.

    Attributes:
        sequence: The highest that was accepted; a lower one is refused.
        deployment: What was accepted last.
        length_bytes: Of the target's bundle, where it was signed.
        epoch: Of the controller that asked for it; for the same deployment, a lower one is refused.
        target: What is being deployed and has not ended.
        running: What `current` shows: the last that was deployed successfully.
        previous: What ran before that.
        outcome: The last report that ended a deployment.
    """

    sequence: int = 0
    deployment: str = ""
    epoch: int = 0
    length_bytes: int | None = None
    target: Desired | None = None
    running: Desired | None = None
    previous: Desired | None = None
    outcome: Reported | None = None


class Disk:
    """The folder of one robot."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.versions = root / "versions"
        self.archives = root / "archives"
        self.images = root / "images"
        self.image_files = root / "image-files"
        self.downloads = root / "downloads"
        self.logs = root / "logs"
        self.current = root / "current"
        for folder in (self.versions, self.archives, self.images, self.image_files, self.downloads, self.logs):
            make_folder(folder)

    def load(self) -> RobotState:
        """Returns what the robot remembers; nothing on a new robot.

        A state that cannot be read, because another version of Simyard wrote it, is set aside: the robot then takes its
        latest desired state again. The sequence stands in a file of its own, so that no older state is accepted.
        """
        path = self.root / "state.json"
        try:
            path.chmod(0o600)  # whoever wrote it
            return RobotState.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            return self._fresh_state()
        except ValidationError as exc:
            _LOG.error("%s is set aside: %s", path, exc)
            path.replace(path.with_suffix(".unreadable"))
            return self._fresh_state()

    def save(self, state: RobotState) -> None:
        """Writes what the robot remembers, whole, and settled on the disk.

        Raises:
            OSError: The disk is full, read-only or broken; what was remembered before is still there.
        """
        if self._sequence() != state.sequence:
            with whole_file(self.root / _SEQUENCE) as file:
                file.write(str(state.sequence).encode())
        # It may hold what applications are told in confidence, so nobody else reads it.
        with whole_file(self.root / "state.json", mode=0o600) as file:
            file.write(state.model_dump_json().encode())

    def _fresh_state(self) -> RobotState:
        return RobotState(sequence=max(0, self._sequence() - 1))

    def _sequence(self) -> int:
        try:
            return int((self.root / _SEQUENCE).read_bytes())
        except (FileNotFoundError, ValueError):
            return 0

    def download(self, digest: str) -> Path:
        """Returns the file for what has arrived of a bundle; what had arrived of others is removed."""
        for path in self.downloads.glob(f"*{_PARTIAL}"):
            if path.name != f"{digest}{_PARTIAL}":
                path.unlink()
        return self.downloads / f"{digest}{_PARTIAL}"

    def version(self, digest: str) -> Path:
        """Returns the folder of an installed bundle, which may not be there."""
        return self.versions / digest

    def archive(self, digest: str) -> Path:
        """Returns the file that a bundle was unpacked from, which may not be there."""
        return self.archives / digest

    def image(self, digest: str) -> Path | None:
        """Returns the folder with the files of a bundle that is a container image, unpacked once; None for another one.

        Raises:
            BundleRefused: Its layers are not those that it names, or cannot be unpacked.
            StoreFull: The disk is full.
        """
        return image_root(self.version(digest), ImageFolders(self.images / digest, self.image_files))

    def switch(self, digest: str | None) -> None:
        """Makes `current` show an installed bundle, or go away."""
        _link(self.current, digest)

    def remember(self, digest: str | None) -> None:
        """Makes `previous` show an installed bundle, or go away."""
        _link(self.root / "previous", digest)

    def tidy(self, state: RobotState) -> None:
        """Removes half-made folders and versions that nothing refers to."""
        kept = {each.digest for each in (state.target, state.running, state.previous) if each}
        for path in (*self.versions.iterdir(), *self.archives.iterdir(), *self.images.iterdir()):
            if path.name not in kept:
                discard(path)
        for path in self.images.glob("*/.*"):  # half-unpacked when this robot lost its power
            discard(path)
        for path in self.image_files.iterdir():
            if path.lstat().st_nlink == 1:  # of no image any more
                path.unlink()
        for path in self.downloads.iterdir():
            if path.suffix != _PARTIAL:
                path.unlink(missing_ok=True)


def discard(path: Path) -> None:
    """Removes what lies in the place of a version, whatever it is."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):  # as of a folder: what stays in the way is met by who needs the place
            path.unlink()


def _link(link: Path, digest: str | None) -> None:
    if digest is None:
        link.unlink(missing_ok=True)
    elif link.is_symlink() and link.readlink() == Path("versions") / digest:
        return  # a full disk has no room for another
    else:
        fresh = link.with_name(f".{link.name}-{uuid4().hex}")
        fresh.symlink_to(Path("versions") / digest)
        fresh.replace(link)
    settle_names(link.parent)


@contextmanager
def lock_folder(root: Path) -> Generator[Callable[[], bool]]:
    """Yields a function that tries to take the lock, and returns whether this process has it.

    The lock is free again at the end of the block, or when its holder dies.

    Args:
        root: The robot's folder, which exists.
    """
    # Who can open it can lock it, so a robot's programs must not.
    descriptor = os.open(root / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        os.fchmod(descriptor, 0o600)
        yield lambda: _try_lock(descriptor)
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
