"""Private keys in a folder of their own: one file each, readable by its owner alone, and never inside the store."""

import fcntl
import os
import stat
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args
from urllib.parse import unquote
from uuid import uuid4

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from pydantic import ValidationError

from specs.base import Fault, Spec
from specs.errors import DocumentError
from tasks.deploy.trust.tuf_names import CryptoSigner
from tasks.storage.base.atomic_file import flush_to_disk, make_folder, settle_names
from tasks.storage.base.store import Store

Role = Literal["root", "targets", "deployer", "snapshot", "timestamp"]
ROLES: tuple[Role, ...] = get_args(Role)
ROOT_FILE = "root.json"
_NOTES = "signer.json"
_LOCK = ".lock"


class SignerNotes(Spec):
    """What a folder of keys knows besides its keys.

    Attributes:
        repository: Id of the metadata's folder in the store.
        store: Id of the store; keys are for one.
        timestamp: The highest version that was seen, so that older metadata is refused.
    """

    repository: str
    store: str
    timestamp: int = 0


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
            raise DocumentError([Fault(path="keys", value=str(self.folder), allowed=allowed)])
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
        try:
            return SignerNotes.model_validate_json((self.folder / _NOTES).read_bytes())
        except FileNotFoundError:
            return None
        except ValidationError as exc:
            fault = Fault(path="keys", value=str(self.folder / _NOTES), allowed="what simyard fleet keys init wrote")
            raise DocumentError([fault]) from exc

    def save_notes(self, notes: SignerNotes) -> None:
        """Writes what the folder knows."""
        _write(self.folder / _NOTES, notes.model_dump_json().encode())

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
        raise DocumentError([Fault(path="role", value=repr(name), allowed=", ".join(ROLES))])
    return found


def keyring(folder: Path, store: Store, *, make: bool = False) -> Keyring:
    """Returns the keys in a folder.

    Args:
        folder: Where they are.
        store: What they sign for; they must not lie in it.
        make: Whether to make the folder.

    Raises:
        DocumentError: The folder lies in the store, where everybody who reads the store would read the keys, or is
            not there.
    """
    where = folder.expanduser().resolve()
    if store.url.startswith("file://") and where.is_relative_to(Path(unquote(store.url[7:])).resolve()):
        raise _refused(folder, f"a folder outside {store.url}: private keys never lie in the store")
    if make:
        make_folder(where.parent)
        where.mkdir(mode=0o700, exist_ok=True)
    if not where.is_dir():
        raise _refused(folder, "a folder with keys; simyard fleet keys init --keys DIR makes one")
    return Keyring(where)


def _read(path: Path) -> CryptoSigner:
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise _refused(path, f"a private key that only you can read; chmod 600 {path}")
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as exc:
        raise _refused(path, "an Ed25519 private key, as simyard fleet keys init writes it") from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise _refused(path, "an Ed25519 private key, as simyard fleet keys init writes it")
    return CryptoSigner(key)


def _write(path: Path, body: bytes, mode: int = 0o600) -> None:
    """Writes a file whole, with its mode from the first moment on."""
    hidden = path.with_name(f".{path.name}-{uuid4().hex}")
    descriptor = os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(body)
            flush_to_disk(file)
        hidden.replace(path)
    finally:
        hidden.unlink(missing_ok=True)
    settle_names(path.parent)


def _refused(path: Path, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="keys", value=str(path), allowed=allowed)])
