"""Access keys: what a key is, the part of a store that it is limited to, and the file that keeps several.

The file has the form of ~/.aws/credentials, a profile for each key; only its owner may read it, and a gateway sees each
change at its next request.
"""

import configparser
import fcntl
import io
import os
import secrets
import shlex
import socket
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Literal, get_args

from specs.arn import KINDS, ResourceKind, parse_reference
from specs.errors import DocumentError, ResourceAlreadyExists, ResourceNotFound
from specs.settings import region
from tasks.storage.base.keys import checked_name
from tasks.storage.base.local_files import whole_file
from tasks.storage.base.proxies import exception_lines

_SCOPES = "an ARN, or KIND/NAME such as deployment-fleet/home; a * at its end stands for every name that begins so"
KeyRight = Literal["read", "simulate", "deploy"]
RIGHTS: tuple[KeyRight, ...] = get_args(KeyRight)
_ID, _SECRET, _RIGHTS, _ON = "aws_access_key_id", "aws_secret_access_key", "simyard_rights", "simyard_on"
_FIELDS = frozenset({_ID, _SECRET, _RIGHTS, _ON})
_NO_SECTION = "\0"
FIRST = "default"
_OTHERS = 0o077
_EVERYWHERE = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 - to be told apart from names that clients can ask for


@dataclass(frozen=True)
class Scope:
    """Some resources of one kind.

    Attributes:
        text: As the owner wrote it.
        kind: Of the resources.
        path: Their name, or how it begins.
        open: Whether names may go on behind that.
        store_id: The store that they are in; empty for whichever the gateway serves.
    """

    text: str
    kind: ResourceKind
    path: str
    open: bool
    store_id: str

    def covers(self, kind: ResourceKind, path: str, store_id: str) -> bool:
        """Returns whether a resource of the store with that id is among them."""
        if kind != self.kind or self.store_id not in {"", store_id}:
            return False
        return path.startswith(self.path) if self.open else path == self.path

    def covers_all(self, kind: ResourceKind, store_id: str) -> bool:
        """Returns whether every resource of a kind is among them, also those that are yet to be made."""
        return self.open and not self.path and self.covers(kind, "", store_id)


def parse_scope(text: str) -> Scope:
    """Returns the resources that a text names.

    Raises:
        DocumentError: It is neither an ARN nor KIND/NAME, or a * is not at its end.
    """
    named = text.removesuffix("*")
    if "*" in named or any(char.isspace() for char in named):
        raise _refused_scope(text)
    if not named.startswith("arn:"):
        kind, slash, path = named.partition("/")
        return _scope(text, kind if slash else "", path, "")
    try:
        reference = parse_reference(named)
    except ValueError as exc:
        raise _refused_scope(text) from exc
    own = named.split(":")[3] if named.startswith("arn:simyard:") else ""
    return _scope(text, reference.kind or "", reference.path, own)


def _scope(text: str, kind: str, path: str, store_id: str) -> Scope:
    for known in KINDS:
        if kind == known and (path or text.endswith("*")):
            return Scope(text, known, path, text.endswith("*"), store_id)
    raise _refused_scope(text)


def _refused_scope(text: str) -> DocumentError:
    return DocumentError.of("--on", repr(text), _SCOPES, source="access key")


@dataclass(frozen=True)
class AccessKey:
    """Who may call, and what.

    Attributes:
        name: The profile; it stands in the log of actions.
        key_id: What a request names.
        secret: What a request is signed with.
        rights: What it may do; none of them is part of another.
        scopes: What it is limited to; empty for everything in the store.
    """

    name: str
    key_id: str
    secret: str = field(repr=False)
    rights: frozenset[KeyRight]
    scopes: tuple[Scope, ...] = ()


def new_key(name: str, rights: Iterable[str], on: Iterable[str] = ()) -> AccessKey:
    """Returns a key that nobody had before.

    Args:
        name: The profile's.
        rights: Some of ``RIGHTS``.
        on: What it is limited to, as ``parse_scope`` reads it.

    Raises:
        DocumentError: The name, a right or a limit is none.
    """
    key_id = f"SIMYARD{secrets.token_hex(7)[:13].upper()}"
    scopes = tuple(parse_scope(text) for text in on)
    return AccessKey(_checked_profile(name), key_id, secrets.token_urlsafe(30), _checked_rights(rights), scopes)


def read_profiles(text: str, source: str) -> Mapping[str, AccessKey]:
    """Returns the keys of a file by their ids.

    Args:
        text: What is in the file.
        source: Its name, for the message.

    Raises:
        DocumentError: It is not such a file; the message holds no secret.
    """
    parser = _parser()
    try:
        parser.read_string(text)
    except configparser.Error:  # its own message, and the exception as a cause, may show the line with the secret
        raise _fault(source, "the file", "profiles in the form of ~/.aws/credentials, each name once") from None
    keys = [_key(name, dict(parser[name]), source) for name in parser.sections()]
    found = {key.key_id: key for key in keys}
    if len(found) < len(keys):
        raise _fault(source, _ID, "another one in each profile")
    return found


def profiles_text(keys: Iterable[AccessKey]) -> str:
    """Returns the file that keeps the keys."""
    parser = _parser()
    for key in keys:
        parser[key.name] = {_ID: key.key_id, _SECRET: key.secret, _RIGHTS: " ".join(sorted(key.rights))}
        if key.scopes:
            parser[key.name][_ON] = " ".join(scope.text for scope in key.scopes)
    out = io.StringIO()
    parser.write(out)
    return out.getvalue()


def _key(name: str, fields: Mapping[str, str], source: str) -> AccessKey:
    if missing := sorted({_ID, _SECRET, _RIGHTS} - {each for each, value in fields.items() if value}):
        raise _fault(source, name, f"a profile with {', '.join(missing)}")
    if unknown := sorted(fields.keys() - _FIELDS):
        raise _fault(source, name, f"a profile without {', '.join(unknown)}")
    if _ON in fields and not fields[_ON].split():  # an emptied limit is not "no limit"
        raise _fault(source, name, f"a profile without {_ON}, or with something in it")
    scopes = tuple(parse_scope(text) for text in fields.get(_ON, "").split())
    return AccessKey(name, fields[_ID], fields[_SECRET], _checked_rights(fields[_RIGHTS].split()), scopes)


def _checked_profile(name: str) -> str:
    if name.upper() == configparser.DEFAULTSECT:  # AWS's clients take [DEFAULT] for what all profiles share
        if name != "default":
            raise _fault("access key", name, "another name, or default")
        return name
    return checked_name(name)


def _checked_rights(rights: Iterable[str]) -> frozenset[KeyRight]:
    asked = set(rights)
    if not asked or not asked <= {*RIGHTS}:
        raise _fault("access key", " ".join(sorted(asked)), f"some of {', '.join(RIGHTS)}")
    return frozenset(right for right in RIGHTS if right in asked)


def _parser() -> configparser.ConfigParser:
    return configparser.ConfigParser(interpolation=None, default_section=_NO_SECTION, delimiters=("=",))


def _fault(source: str, value: str, allowed: str) -> DocumentError:
    return DocumentError.of("access key", repr(value), allowed, source=source)


def read_keys(path: Path) -> Mapping[str, AccessKey]:
    """Returns the keys of a file by their ids; none if there is no file.

    Raises:
        DocumentError: Others may read or have written it, or it is no file of keys.
    """
    try:
        with path.open(encoding="utf-8") as file:
            found = os.fstat(file.fileno())
            if found.st_mode & _OTHERS or found.st_uid != os.geteuid():
                raise _refused_file(
                    path, f"a file of this account alone; others may read it, or own it: chmod 600 {path}"
                )
            return read_profiles(file.read(), str(path))
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as exc:
        raise _refused_file(path, f"a file that can be read: {exc}") from None


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
            raise ResourceAlreadyExists.of("access key", repr(name), allowed, source=str(path))
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
    raise ResourceNotFound.of("access key", repr(name), allowed, source=str(path))


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


def _refused_file(path: Path, allowed: str) -> DocumentError:
    return DocumentError.of("access keys", repr(str(path)), allowed, source="simyard")


def gateway_url(host: str, port: int, *, is_encrypted: bool) -> str:
    """Returns the address that clients ask for."""
    named = socket.gethostname() if host in _EVERYWHERE else f"[{host}]" if ":" in host else host
    return f"{'https' if is_encrypted else 'http'}://{named}:{port}"


def export_lines(key: AccessKey, url: str, model: Path | None = None) -> Iterator[str]:
    """Yields lines that a shell obeys, after which boto3 and the AWS CLI find the gateway; they hold the secret.

    Args:
        key: Whose they are.
        url: Of the gateway.
        model: The folder with RoboMaker's model, if SDKs do not find it themselves.

    Raises:
        DocumentError: SIMYARD_REGION is no name of a region.
    """
    variables = {
        "AWS_ACCESS_KEY_ID": key.key_id,
        "AWS_SECRET_ACCESS_KEY": key.secret,
        "AWS_ENDPOINT_URL_ROBOMAKER": url,
        "AWS_DEFAULT_REGION": region(),
        **({"AWS_DATA_PATH": str(model.expanduser().absolute())} if model else {}),
    }
    for name, value in variables.items():
        yield f"export {name}={shlex.quote(value)}"
    yield "unset AWS_SESSION_TOKEN"
    yield from exception_lines(url, os.environ)
    if model is None:
        yield "# SDKs that have no model of RoboMaker: simyard serve --model-only --model ~/.aws/models"
