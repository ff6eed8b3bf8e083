"""Whether a server answers, and the password that it asks for, in a file that only its owner can read."""

import base64
import os
import re
import secrets
import socket
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from http.client import HTTPException
from pathlib import Path
from types import MappingProxyType
from urllib.parse import urlsplit

from specs.errors import StageFailed
from tasks.storage.base.proxies import is_local

_USER = "simyard"
_SILENT = 0
_UNAUTHORIZED, _FORBIDDEN = 401, 403
# Of what a server says of its health; Prefect's says ``true``.
_BODY_BYTES = 64
# What web servers say of a bad certificate; Prefect may well be configured to trust this one.
_UNTRUSTED = 495


def new_password() -> str:
    """Returns a user and a new password as Prefect takes them, ``user:password``."""
    return f"{_USER}:{secrets.token_urlsafe(32)}"


def password_file(home: Path) -> Path:
    """Returns where the password of the server that stays is."""
    return home / "password"


def write_password(home: Path, password: str) -> None:
    """Writes the password of the server that stays."""
    private_file(password_file(home))
    password_file(home).write_text(password)


def read_password(home: Path) -> str:
    """Returns the password of the server that stays; nothing if there is none.

    Raises:
        StageFailed: Others can read it.
    """
    path = password_file(home)
    try:
        with path.open() as file:
            if os.fstat(file.fileno()).st_mode & 0o077:
                raise StageFailed("InternalServiceError", f"{path}: others can read it; simyard down, then simyard up")
            return file.read()
    except FileNotFoundError:
        return ""


def private_file(path: Path) -> None:
    """Makes a file, if it is not there, that only its owner can read; makes one that is there such a file."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        os.fchmod(descriptor, 0o600)
    finally:
        os.close(descriptor)


def authorization(password: str) -> dict[str, str]:
    """Returns the header by which a request says the password; none for an empty one."""
    return {"Authorization": f"Basic {base64.b64encode(password.encode()).decode()}"} if password else {}


def is_healthy(api_url: str, timeout_s: float = 1.0) -> bool:
    """Returns whether a healthy Prefect server answers at the URL."""
    return _status(api_url, timeout_s) == 200


def is_answering(api_url: str, timeout_s: float = 5.0) -> bool:
    """Returns whether anything answers at the URL: a server that wants a key first refuses, and is there."""
    return _SILENT < _status(api_url, timeout_s) < 500


def speaks_prefect(api_url: str, timeout_s: float = 5.0) -> bool:
    """Returns False only of a server that answers as none of Prefect's does, such as its pages, or a web server.

    One that wants a key first, or that is in trouble, may be one.
    """
    status, body = _answer(api_url, timeout_s)
    if status == 200:
        return body.strip() == b"true"
    return status in {_SILENT, _UNAUTHORIZED, _FORBIDDEN, _UNTRUSTED} or status >= 500


def refuses(api_url: str, password: str, timeout_s: float = 5.0) -> bool:
    """Returns whether a Prefect server asks for another password than this one; one that is silent does not."""
    return _status(api_url, timeout_s, "admin/version", authorization(password)) == _UNAUTHORIZED


def is_listening(api_url: str, timeout_s: float = 10.0) -> bool:
    """Returns False only if this moment nothing listens at the URL's address; a server that is busy listens still."""
    try:
        return accepts(api_url, timeout_s)
    except TimeoutError:
        return True


def accepts(api_url: str, timeout_s: float = 5.0) -> bool:
    """Returns whether a connection to the URL's address is taken, as by a server that is too busy to answer.

    Raises:
        TimeoutError: Nobody says.
    """
    try:
        parts = urlsplit(api_url)
        port = parts.port or (443 if parts.scheme == "https" else 80)
        with socket.create_connection((parts.hostname or "", port), timeout=timeout_s):
            return True
    except TimeoutError:
        raise
    except (OSError, ValueError):  # refused, or no address at all
        return False


def succeeds_within(question: Callable[[], bool], for_s: float = 3.0, pause_s: float = 0.5) -> bool:
    """Returns whether one of several tries within so many seconds succeeds: a busy server may miss a few."""
    until_s = time.monotonic() + for_s
    while not (answer := question()) and time.monotonic() < until_s:
        time.sleep(pause_s)
    return answer


def url_without_password(api_url: str) -> str:
    """Returns the URL as it may be printed: without a password."""
    return re.sub(r"//[^/]*@", "//***@", api_url)


def _status(
    api_url: str, timeout_s: float, path: str = "health", headers: Mapping[str, str] = MappingProxyType({})
) -> int:
    """Returns the HTTP status of what the server answers, by default of its health, or 0 when nothing answers."""
    return _answer(api_url, timeout_s, path, headers)[0]


def _answer(
    api_url: str, timeout_s: float, path: str = "health", headers: Mapping[str, str] = MappingProxyType({})
) -> tuple[int, bytes]:
    """Returns the status as above, and how the body begins."""
    handlers = [urllib.request.ProxyHandler({})] if is_local(api_url) else []
    try:
        asked = urllib.request.Request(f"{api_url}/{path}", headers=dict(headers))  # noqa: S310 - the user's own URL
        with urllib.request.build_opener(*handlers).open(asked, timeout=timeout_s) as reply:
            return int(reply.status), bytes(reply.read(_BODY_BYTES))
    except urllib.error.HTTPError as exc:
        return exc.code, b""
    except urllib.error.URLError as exc:
        return _UNTRUSTED if isinstance(exc.reason, ssl.SSLError) else _SILENT, b""
    except (OSError, HTTPException, ValueError):
        return _SILENT, b""


def is_port_free(port: int) -> bool:
    """Returns whether a server could listen on a port of 127.0.0.1 now."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: old connections may linger
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
