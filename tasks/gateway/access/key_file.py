"""The file with the access keys, which only its owner may read; a gateway sees each change at its next request."""

import fcntl
import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Lock

from specs.base import Fault
from specs.errors import DocumentError, ResourceAlreadyExists, ResourceNotFound
from tasks.gateway.access.access_key import RIGHTS, AccessKey, new_key, profiles_text, read_profiles
from tasks.storage.base.atomic_file import whole_file

ACCESS_FILE = "SIMYARD_ACCESS_FILE"
FIRST = "default"
_OTHERS = 0o077


def access_file() -> Path:
    """Returns SIMYARD_ACCESS_FILE, else ``simyard/access-keys`` in the user's folder for settings."""
    chosen = os.environ.get(ACCESS_FILE)
    if chosen:
        return Path(chosen)
    settings = os.environ.get("XDG_CONFIG_HOME") or Path(os.environ.get("HOME") or Path.home()) / ".config"
    return Path(settings) / "simyard" / "access-keys"


def read_keys(path: Path) -> Mapping[str, AccessKey]:
    """Returns the keys of a file by their ids; none if there is no file.

    Raises:
        DocumentError: Others may read or have written it, or it is no file of keys.
    """
    try:
        with path.open(encoding="utf-8") as file:
            found = os.fstat(file.fileno())
            if found.st_mode & _OTHERS or found.st_uid != os.geteuid():
                raise _refused(path, f"a file of this account alone; others may read it, or own it: chmod 600 {path}")
            return read_profiles(file.read(), str(path))
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as exc:
        raise _refused(path, f"a file that can be read: {exc}") from None


def first_key(path: Path) -> AccessKey | None:
    """Returns the key that was made because there was no file yet, with all rights; None if there was one."""
    with _turn(path):
        if path.exists():
            return None
        key = new_key(FIRST, RIGHTS)
        _write(path, [key])
        return key


def add_key(path: Path, name: str, rights: Iterable[str], on: Iterable[str] = ()) -> AccessKey:
    """Returns a new key that is in the file now.

    Raises:
        ResourceAlreadyExists: The name is taken.
        DocumentError: The name, a right or a limit is none.
    """
    with _turn(path):
        keys = read_keys(path)
        if any(key.name == name for key in keys.values()):
            allowed = f"a new name; simyard access revoke {name} makes it free"
            raise ResourceAlreadyExists([Fault(path="access key", value=repr(name), allowed=allowed)], str(path))
        key = new_key(name, rights, on)
        _write(path, [*keys.values(), key])
        return key


def revoke_key(path: Path, name: str) -> AccessKey:
    """Returns the key that is not in the file any more, by its name or id.

    Raises:
        ResourceNotFound: There is none.
    """
    with _turn(path):
        keys = read_keys(path)
        key = find_key(keys, name, path)
        _write(path, [each for each in keys.values() if each is not key])
        return key


def find_key(keys: Mapping[str, AccessKey], name: str, path: Path) -> AccessKey:
    """Returns the key of that name or id.

    Raises:
        ResourceNotFound: There is none.
    """
    for key in keys.values():
        if name in {key.name, key.key_id}:
            return key
    allowed = "a key of the file; simyard access list shows them"
    raise ResourceNotFound([Fault(path="access key", value=repr(name), allowed=allowed)], str(path))


class KeyFile:
    """The keys of a file as they are now; several threads may ask."""

    def __init__(self, path: Path) -> None:
        """Reads nothing yet."""
        self._path = path
        self._lock = Lock()
        self._mark: tuple[int, ...] | None = None
        self._keys: Mapping[str, AccessKey] = {}

    def key(self, key_id: str) -> AccessKey | None:
        """Returns the key of that id; None if there is none, or none any more.

        Raises:
            DocumentError: The file cannot be trusted or read; so long, no key is known.
        """
        with self._lock:
            mark = self._state()
            if mark != self._mark:
                self._keys = read_keys(self._path)  # raises as long as the file cannot be trusted: no old key is used
                self._mark = mark
            return self._keys.get(key_id)

    def _state(self) -> tuple[int, ...]:
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return ()
        return (found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_mode, found.st_uid)


@contextmanager
def _turn(path: Path) -> Generator[None]:
    """Lets one at a time change a file: of two that add a key at once, both are in it."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor = os.open(path.with_name(f"{path.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _write(path: Path, keys: Iterable[AccessKey]) -> None:
    with whole_file(path, 0o600) as file:
        file.write(profiles_text(keys).encode())


def _refused(path: Path, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="access keys", value=repr(str(path)), allowed=allowed)], source="simyard")
