"""A robot's checks before it downloads: TUF's client workflow, and whether what it is asked is signed and in force.

The root of trust is pinned when the agent is installed. Everything that was verified is kept on the robot, so that it
never accepts anything older.
"""

import os
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from specs.errors import ObjectNotFound, ObjectTooBig, StoreAccessDenied, StoreError, TrustExpired, TrustRefused
from tasks.deploy.fleet.states import Desired
from tasks.deploy.trust.keyring import (
    BadVersionNumberError,
    DownloadError,
    DownloadHTTPError,
    DownloadLengthMismatchError,
    ExpiredMetadataError,
    FetcherInterface,
    LengthOrHashMismatchError,
    Metadata,
    RepositoryError,
    Role,
    Targets,
    UnsignedMetadataError,
    Updater,
    UpdaterConfig,
)
from tasks.deploy.trust.metadata import MOST_METADATA_BYTES, bundle_target, deployer_role, read_root, repository_of
from tasks.deploy.trust.signed_fleets import read_fleets, verify_desired
from tasks.storage.base.local_files import make_folder, settle_names
from tasks.storage.base.store import Store

_ASK_THE_OWNER = "find out who writes to the store"
_CONFIG = UpdaterConfig(max_root_rotations=64, max_delegations=2, targets_max_length=MOST_METADATA_BYTES)


class Verifier:
    """Checks desired states against a pinned root of trust.

    Args:
        store: Where metadata is.
        folder: Where the robot keeps what it has verified.
        root: The root of trust, root metadata as ``simyard fleet keys init`` wrote it.
        now_s: The robot's clock, seconds since 1970.

    Raises:
        TrustRefused: The root of trust is none.
    """

    def __init__(self, store: Store, folder: Path, root: bytes, now_s: Callable[[], float] = time.time) -> None:
        self._store = store
        self._root = root
        self._now_s = now_s
        self._repository = repository_of(read_root(root))
        self._folder = folder / self._repository

    def __call__(self, desired: Desired) -> int:
        """Returns the length of the bundle in bytes, for what the keys vouch for.

        Raises:
            TrustExpired: They do not any more, by this robot's clock.
            TrustRefused: They do not; says what is wrong and what helps.
            StoreError: The store is away.
            OSError: This robot's disk is full, read-only or broken.
        """
        make_folder(self._folder)
        try:
            length_bytes = self._check(desired)
        except (RepositoryError, DownloadError) as exc:
            cause = exc.__cause__
            if isinstance(cause, StoreError) and not isinstance(cause, ObjectNotFound | ObjectTooBig):
                raise cause from exc
            refusal = TrustExpired if isinstance(exc, ExpiredMetadataError) else TrustRefused
            raise refusal(f"{_explanation(exc)} ({exc})") from exc
        _sync_to_disk(self._folder)
        return length_bytes

    def _check(self, desired: Desired) -> int:
        prefix = f"trust/{self._repository}/"
        fetcher = _StoreFetcher(self._store)
        updater = Updater(str(self._folder), prefix, fetcher=fetcher, config=_CONFIG, bootstrap=self._root)
        updater.refresh()
        targets = self._verified("targets")
        keys = targets.delegations.keys if targets.delegations else {}
        verify_desired(desired, {keyid: keys[keyid] for keyid in deployer_role(targets).keyids})
        if desired.expires_at_s <= self._now_s():
            raise TrustExpired(f"it expired at {_date(desired.expires_at_s)}; {self._clock()} deploy again")
        found = updater.get_targetinfo(bundle_target(desired.digest))
        read_fleets(self._verified("deployer")).admit(desired)
        if found is None or found.hashes.get("sha256") != desired.digest:
            raise TrustRefused(f"bundle {desired.digest[:12]} is not on the deployer's signed list; deploy it again")
        return found.length

    def _verified(self, role: Role) -> Targets:
        """Returns metadata that the updater has just verified and written."""
        return Metadata[Targets].from_bytes((self._folder / f"{role}.json").read_bytes()).signed

    def _clock(self) -> str:
        return f"this robot's clock says {_date(self._now_s())};"


class _StoreFetcher(FetcherInterface):
    """Reads metadata from a store; URLs are keys."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def _fetch(self, url: str) -> Iterator[bytes]:
        try:
            return iter([self._store.get(url, MOST_METADATA_BYTES).body])
        except ObjectTooBig as exc:
            raise DownloadLengthMismatchError(str(exc)) from exc
        except ObjectNotFound as exc:
            raise DownloadHTTPError(str(exc), 404) from exc
        except StoreAccessDenied as exc:  # S3's answer for what is not there, to who may not list
            raise DownloadHTTPError(str(exc), 403) from exc


def _explanation(exc: RepositoryError | DownloadError) -> str:
    """Returns what a person has to know about a refusal."""
    if isinstance(exc, ExpiredMetadataError):
        now = _date(time.time())
        return f"signed metadata expired, and this robot's clock says {now}: run simyard fleet keys renew"
    if isinstance(exc, BadVersionNumberError):
        return f"signed metadata in the store is older than what this robot has seen: {_ASK_THE_OWNER}"
    if isinstance(exc, UnsignedMetadataError):
        return f"metadata is signed by keys that this robot does not trust: {_ASK_THE_OWNER}"
    if isinstance(exc, DownloadHTTPError):
        return "the store has no metadata signed for this robot's root of trust: restore trust/ from a backup"
    if isinstance(exc, LengthOrHashMismatchError | DownloadError):
        return f"metadata is not the file that was signed for: {_ASK_THE_OWNER}"
    return f"metadata is damaged or does not fit together: {_ASK_THE_OWNER}"


def _date(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _sync_to_disk(folder: Path) -> None:
    """Waits until what was verified is on the disk: a loss of power must not make the robot forget it."""
    for path in folder.rglob("*.json"):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    for names in (folder / "root_history", folder):
        settle_names(names)
