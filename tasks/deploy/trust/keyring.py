"""Private keys in a folder of their own: one file each, readable by its owner alone, and never inside the store.

Names of python-tuf and securesystemslib are imported here once for all.
"""

import fcntl
import os
import shlex
import stat
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from threading import get_ident
from types import ModuleType
from typing import Annotated, Literal, TypeVar, get_args
from urllib.parse import unquote

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from pydantic import Field, ValidationError

from specs.base import Spec
from specs.errors import DocumentError
from tasks.storage.base.local_files import room_in, settle_names, whole_file
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

_CLOUD = "boto3"


# securesystemslib imports the client of a cloud for keys that lie there, if that is installed, which takes
# longer than all else that an agent imports for signatures. Simyard has its keys in files, so it is imported without.
class _NoCloud(MetaPathFinder):
    """Says to one thread that the client is not installed."""

    def __init__(self) -> None:
        self._thread = get_ident()

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname == _CLOUD and get_ident() == self._thread:
            raise ModuleNotFoundError(fullname, name=fullname)
        return None


@contextmanager
def _without_cloud() -> Generator[None]:
    finder = _NoCloud()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


with _without_cloud():
    from securesystemslib import signer as _signer
    from tuf.api import metadata as _metadata
    from tuf.api.exceptions import (
        BadVersionNumberError,
        DownloadError,
        DownloadHTTPError,
        DownloadLengthMismatchError,
        ExpiredMetadataError,
        LengthOrHashMismatchError,
        RepositoryError,
        UnsignedMetadataError,
    )
    from tuf.api.metadata import Metadata
    from tuf.api.serialization import DeserializationError
    from tuf.ngclient import FetcherInterface, Updater, UpdaterConfig

CryptoSigner = _signer.CryptoSigner  # pyright: ignore[reportPrivateImportUsage] - documented
Key = _signer.Key  # pyright: ignore[reportPrivateImportUsage] - documented
RawSignature = _signer.Signature  # pyright: ignore[reportPrivateImportUsage] - documented
DelegatedRole = _metadata.DelegatedRole  # pyright: ignore[reportPrivateImportUsage] - documented
Delegations = _metadata.Delegations  # pyright: ignore[reportPrivateImportUsage] - documented
MetaFile = _metadata.MetaFile  # pyright: ignore[reportPrivateImportUsage] - documented
Root = _metadata.Root  # pyright: ignore[reportPrivateImportUsage] - documented
Snapshot = _metadata.Snapshot  # pyright: ignore[reportPrivateImportUsage] - documented
TargetFile = _metadata.TargetFile  # pyright: ignore[reportPrivateImportUsage] - documented
Targets = _metadata.Targets  # pyright: ignore[reportPrivateImportUsage] - documented
Timestamp = _metadata.Timestamp  # pyright: ignore[reportPrivateImportUsage] - documented

__all__ = [
    "BadVersionNumberError",
    "CryptoSigner",
    "DelegatedRole",
    "Delegations",
    "DeserializationError",
    "DownloadError",
    "DownloadHTTPError",
    "DownloadLengthMismatchError",
    "ExpiredMetadataError",
    "FetcherInterface",
    "Key",
    "LengthOrHashMismatchError",
    "MetaFile",
    "Metadata",
    "RawSignature",
    "RepositoryError",
    "Root",
    "Snapshot",
    "TargetFile",
    "Targets",
    "Timestamp",
    "UnsignedMetadataError",
    "Updater",
    "UpdaterConfig",
]


Role = Literal["root", "targets", "deployer", "snapshot", "timestamp"]
ROLES: tuple[Role, ...] = get_args(Role)
ROOT_FILE = "root.json"
_NOTES = "signer.json"
_KEPT = "published.json"
_LOCK = ".lock"


class SignerNotes(Spec):
    """What a folder of keys knows besides its keys.

    Attributes:
        repository: Id of the metadata's folder in the store.
        store: Id of the store; keys are for one.
        timestamp: The highest version that was seen, so that older metadata is refused.
        lifetime_h: For how many hours a timestamp is accepted.
    """

    repository: str
    store: str
    timestamp: int = 0
    lifetime_h: Annotated[int, Field(ge=1, le=8760)] = 24


class KeptMetadata(Spec):
    """The state of the metadata that was signed with these keys last.

    Attributes:
        version: Of its timestamp.
        parts: Its files, by name.
        settled: Whether it is known to have reached the store.
    """

    version: int
    parts: dict[str, str]
    settled: bool


Document = TypeVar("Document", SignerNotes, KeptMetadata)


class Keyring:
    """The keys in a folder, and the root of trust that robots get: ``root.json``, which is no secret."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def create(self, role: Role) -> CryptoSigner:
        """Returns a new key, which is on the disk before it is used."""
        signer = CryptoSigner.generate_ed25519()
        name = f"{role}-{signer.public_key.keyid[:16]}.pem"
        _write(self.folder / name, signer.private_bytes)
        return signer

    def find(self, role: Role, keyids: Iterable[str]) -> CryptoSigner | None:
        """Returns the first of the role's keys that has one of the ids, or None.

        Raises:
            DocumentError: Others may read the key, or it is none.
        """
        wanted = set(keyids)
        signers = (_read(path) for path in sorted(self.folder.glob(f"{role}-*.pem")))
        return next((signer for signer in signers if signer.public_key.keyid in wanted), None)

    def get(self, role: Role, keyids: Iterable[str]) -> CryptoSigner:
        """Returns the role's key.

        Raises:
            DocumentError: It is not here.
        """
        found = self.find(role, keyids)
        if found is None:
            allowed = f"the key {role}-*.pem that the store's metadata names; fetch it from where you keep it offline"
            raise DocumentError.of("keys", str(self.folder), allowed)
        return found

    def keep_only(self, role: Role, keyids: Iterable[str]) -> None:
        """Removes the role's other keys, which are not accepted any more."""
        kept = set(keyids)
        for path in sorted(self.folder.glob(f"{role}-*.pem")):
            if _read(path).public_key.keyid not in kept:
                path.unlink()

    @property
    def root(self) -> bytes | None:
        """The newest root metadata that was seen, or None in a new folder."""
        try:
            return (self.folder / ROOT_FILE).read_bytes()
        except FileNotFoundError:
            return None

    def save_root(self, root: bytes) -> None:
        """Writes what robots are given as their root of trust."""
        _write(self.folder / ROOT_FILE, root, 0o644)

    @property
    def notes(self) -> SignerNotes | None:
        """What the folder knows besides its keys, or None in a new one."""
        return self._document(_NOTES, SignerNotes)

    def save_notes(self, notes: SignerNotes) -> None:
        """Writes what the folder knows."""
        _write(self.folder / _NOTES, notes.model_dump_json().encode())

    @property
    def kept(self) -> KeptMetadata | None:
        """The newest metadata that was signed with these keys here, or None."""
        return self._document(_KEPT, KeptMetadata)

    def keep(self, kept: KeptMetadata) -> None:
        """Writes a copy of the newest metadata."""
        _write(self.folder / _KEPT, kept.model_dump_json().encode())

    def known_for(self, store: Store) -> tuple[SignerNotes, bytes]:
        """Returns what keys for a store know: their notes, and the root of trust.

        Raises:
            DocumentError: There are no keys, or they are for another store.
        """
        notes, root = self.notes, self.root
        if notes is None or root is None:
            raise refused_keys(self.folder, "a folder with keys; simyard fleet keys init --keys DIR makes one")
        self.check_store(notes, store)
        return notes, root

    def check_store(self, notes: SignerNotes, store: Store) -> None:
        """Raises DocumentError for another store than the notes are for."""
        if notes.store != store_id(store):
            allowed = f"the keys of {store.url}; these are for the store with id {notes.store}"
            raise refused_keys(self.folder, allowed)

    def _document(self, name: str, kind: type[Document]) -> Document | None:
        try:
            return kind.model_validate_json((self.folder / name).read_bytes())
        except FileNotFoundError:
            return None
        except ValidationError as exc:
            raise DocumentError.of("keys", str(self.folder / name), "what simyard fleet keys init wrote") from exc

    @contextmanager
    def alone(self) -> Generator[None]:
        """Waits until no other process of this machine works with the folder."""
        descriptor = os.open(self.folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield
        finally:
            os.close(descriptor)


def checked_role(name: str) -> Role:
    """Returns the role of that name.

    Raises:
        DocumentError: There is none.
    """
    roles: dict[str, Role] = {role: role for role in ROLES}
    found = roles.get(name)
    if found is None:
        raise DocumentError.of("role", repr(name), ", ".join(ROLES))
    return found


def keyring(folder: Path, store: Store, *, make: bool = False, in_cache: bool = False) -> Keyring:
    """Returns the keys in a folder.

    Args:
        folder: Where they are.
        store: What they sign for; they must not lie in it.
        make: Whether to make the folder.
        in_cache: Whether it lies in the cache, for robots of this machine: what is above it may be of any kind.

    Raises:
        DocumentError: The folder lies in the store, where everybody who reads the store would read the keys; or is
            not there; or others can write to it, or to one above that it shall be made in; or it is somebody else's.
    """
    where = folder.expanduser().resolve()
    if store.url.startswith("file://") and where.is_relative_to(Path(unquote(store.url[7:])).resolve()):
        raise refused_keys(folder, f"a folder outside {store.url}: private keys never lie in the store")
    if make:
        _require_place([] if in_cache else [above for above in where.parents if above.is_dir()])
        _make(where)
    if not where.is_dir():
        raise refused_keys(folder, "a folder with keys; simyard fleet keys init --keys DIR makes one")
    _require_own(where, new=make)
    return Keyring(where)


def _make(where: Path) -> None:
    """Makes the folder and what is missing above it, for nobody else."""
    for each in (*reversed(where.parents), where):
        if not each.is_dir():
            each.mkdir(mode=0o700, exist_ok=True)
            settle_names(each.parent)


def _require_place(above: Sequence[Path]) -> None:
    """Does nothing for folders above the keys in which nobody else can exchange those."""
    for folder in above:
        found, name = folder.stat(), shlex.quote(str(folder))
        if found.st_uid not in {0, os.geteuid()}:
            raise refused_keys(folder, f"above the keys, a folder of yours, or of root; sudo chown $(id -u) {name}")
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not found.st_mode & stat.S_ISVTX:
            allowed = "above the keys, a folder to which nobody else can write, who could exchange them"
            raise refused_keys(folder, f"{allowed}; chmod go-w {name}")


def _require_own(where: Path, *, new: bool) -> None:
    """Does nothing for a folder to which nobody else can write; one for new keys must be the user's, too."""
    found, name = where.stat(), shlex.quote(str(where))
    if new and found.st_uid != os.geteuid():
        raise refused_keys(where, f"a folder of yours; sudo chown -R $(id -u) {name}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        allowed = "a folder to which nobody else can write, who could exchange the keys"
        raise refused_keys(where, f"{allowed}; chmod go-w {name}")


def _read(path: Path) -> CryptoSigner:
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise refused_keys(path, f"a private key that only you can read; chmod 600 {path}")
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as exc:
        raise refused_keys(path, "an Ed25519 private key, as simyard fleet keys init writes it") from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise refused_keys(path, "an Ed25519 private key, as simyard fleet keys init writes it")
    return CryptoSigner(key)


def _write(path: Path, body: bytes, mode: int = 0o600) -> None:
    """Writes a file whole, with its mode from the first moment on."""
    with room_in(path.parent), whole_file(path, mode) as file:
        file.write(body)


def refused_keys(path: Path, allowed: str) -> DocumentError:
    """Returns the error for a file or folder of keys that is not what it must be."""
    return DocumentError.of("keys", str(path), allowed)
