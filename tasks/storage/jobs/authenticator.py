"""Authenticates what this owner's processes computed, under a key that the store's writers do not have.

The key is the owner's: 32 random bytes in a file that only its owner can read, made when it is first needed, in the
cache folder or where SIMYARD_OWNER_KEY says. Whoever loses it loses time: what cannot be authenticated is simulated
anew (docs/decisions/0010). A batch has a key of its own, made from the owner's, its id and its plan's digest
(HMAC-SHA-256), so that workers of a cluster are given no more than they need.
"""

import hashlib
import hmac
import os
import secrets
from contextlib import suppress
from pathlib import Path

from specs.errors import DocumentError
from specs.settings import OWNER_KEY
from tasks.storage.base.local_files import cache_folder, flush_to_disk, hidden_file, settle_names

MAC_LENGTH = 64
_KEY_BYTES = 32


class BatchAuthenticator:
    """Authenticates the results of one batch under one plan; shows its key to nobody who prints it.

    Attributes:
        job: The batch's id.
        plan: SHA-256 of its plan.
    """

    __slots__ = ("_key", "job", "plan")

    def __init__(self, key: bytes, job: str, plan: str) -> None:
        """Derives the batch's key.

        Args:
            key: The owner's.
            job: The batch's id.
            plan: SHA-256 of the plan that is worked on.
        """
        self.job, self.plan = job, plan
        self._key = hmac.digest(key, _framed(b"simyard-batch-1", job.encode(), plan.encode()), hashlib.sha256)

    def mac(self, what: str, body: bytes) -> str:
        """Returns 64 hexadecimal digits that authenticate bytes.

        Args:
            what: What they are, such as ``chunk 3``: the same bytes as something else have other digits.
            body: The bytes.
        """
        return hmac.new(self._key, _framed(what.encode(), body), hashlib.sha256).hexdigest()

    def authenticates(self, mac: str, what: str, body: bytes) -> bool:
        """Returns whether the digits are those of the bytes."""
        return mac.isascii() and hmac.compare_digest(mac, self.mac(what, body))


def owner_authenticator(job: str, plan: str) -> BatchAuthenticator:
    """Returns the authenticator of a batch on a machine of its owner.

    Raises:
        DocumentError: The file of the key holds something else.
    """
    return BatchAuthenticator(owner_key(), job, plan)


def has_owner_key() -> bool:
    """Returns whether there is a key; who only looks at results makes none.

    Raises:
        DocumentError: This account may not look.
    """
    path = _key_file()
    try:
        return path.is_file()
    except OSError as exc:
        raise _unusable(path, exc) from exc


def owner_key() -> bytes:
    """Returns the owner's key, which is made if there is none.

    Raises:
        DocumentError: The file holds something else, or this account can neither read nor make it.
    """
    path = _key_file()
    try:
        try:
            key = path.read_bytes()
        except FileNotFoundError:
            _make_key(path)
            key = path.read_bytes()
    except OSError as exc:
        raise _unusable(path, exc) from exc
    if len(key) != _KEY_BYTES:
        allowed = f"a file of {_KEY_BYTES} random bytes; remove it, and a new one is made"
        raise DocumentError.of(OWNER_KEY, repr(str(path)), allowed, source="simyard")
    return key


def _unusable(path: Path, exc: OSError) -> DocumentError:
    """Returns what is wrong with a key's file that is not there and cannot be made, or cannot be read."""
    if isinstance(exc, FileNotFoundError) or not path.parent.is_dir():
        state = "there is no such file, and it cannot be made there"
    else:
        state = f"it cannot be read or made ({exc.strerror})"
    remedy = "copy owner/key of the gateway's cache folder there, owned by this account, with mode 600"
    allowed = f"a file of {_KEY_BYTES} random bytes that this account can read; {state}: {remedy}"
    return DocumentError.of(OWNER_KEY, repr(str(path)), allowed, source="simyard")


def _key_file() -> Path:
    chosen = os.environ.get(OWNER_KEY)
    return Path(chosen) if chosen else cache_folder() / "owner" / "key"


def _make_key(path: Path) -> None:
    """Makes the file whole, or finds that another process was first."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with hidden_file(path.parent) as (file, hidden):
        hidden.chmod(0o600)
        file.write(secrets.token_bytes(_KEY_BYTES))
        flush_to_disk(file)
        with suppress(FileExistsError):
            os.link(hidden, path)
    settle_names(path.parent)


def _framed(*parts: bytes) -> bytes:
    """Returns the parts as one message, of which no other parts could be the same."""
    return b"".join(len(part).to_bytes(8, "big") + part for part in parts)
