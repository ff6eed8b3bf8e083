"""The password of a server that stays, in a file that only its owner can read."""

import base64
import os
import secrets
from pathlib import Path

from specs.errors import StageFailed

_USER = "simyard"


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
