"""The files of kept programs: a head line in JSON, then a program's bytes; what is not whole is as good as not there.

Nothing in a file is ever unpickled: the head is JSON, and the program is StableHLO, which JAX reads and compiles.
"""

import hashlib
import json
import logging
import os
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from specs.base import Spec
from tasks.storage.base.atomic_file import HIDDEN, whole_file

logger = logging.getLogger(__name__)
# Of a folder, which holds what one set of applications was compiled to; each takes a tenth of a megabyte or two.
_FILES_AT_MOST = 400
# A program that holds so much, such as the weights of a network, is as quick to trace as to read.
_BYTES_AT_MOST = 64 << 20
_SUFFIX = ".program"


class Dependency(Spec):
    """A file that a program follows from, and no key tells of.

    Attributes:
        path: Where it is.
        sha256: Of what it held.
    """

    path: str
    sha256: str


class Head(Spec):
    """What is known of a program.

    Attributes:
        form: What its arrays are put together to (``tree_form``).
        whole: False for a program that cannot be kept, so that nobody tries again.
        dependencies: Files that must be what they were.
        sha256: Of the program's bytes.
    """

    form: str = ""
    whole: bool = True
    dependencies: tuple[Dependency, ...] = ()
    sha256: str = ""


class KeptFile(NamedTuple):
    """A program and what is known of it."""

    head: Head
    program: bytes


def read_kept(folder: Path, key: str) -> KeptFile | None:
    """Returns what was kept under a key; None where there is nothing, or what is there is not whole or out of date."""
    path = folder / f"{key}{_SUFFIX}"
    try:
        line, _, program = path.read_bytes().partition(b"\n")
        head = Head.model_validate_json(line)
    except (OSError, ValidationError):
        return None
    if head.sha256 != hashlib.sha256(program).hexdigest() or not all(map(_unchanged, head.dependencies)):
        return None
    with suppress(OSError):
        os.utime(path)  # the oldest goes first
    return KeptFile(head, program)


def write_kept(folder: Path, key: str, kept: KeptFile) -> None:
    """Keeps a program under a key, whole or not at all; a folder that cannot be written to keeps nothing."""
    if len(kept.program) > _BYTES_AT_MOST:
        return
    head = kept.head.model_copy(update={"sha256": hashlib.sha256(kept.program).hexdigest()})
    try:
        with whole_file(folder / f"{key}{_SUFFIX}") as file:
            file.write(json.dumps(head.model_dump(mode="json")).encode() + b"\n" + kept.program)
        _thin_out(folder)
    except OSError as exc:
        logger.debug("a program is not kept: %s", exc)


def file_digest(path: Path) -> str:
    """Returns the SHA-256 of a file; empty of one that cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _unchanged(dependency: Dependency) -> bool:
    return file_digest(Path(dependency.path)) == dependency.sha256


def _thin_out(folder: Path) -> None:
    """Removes the programs that were used longest ago, and what a process left that was killed while it wrote."""
    kept = [path for path in folder.iterdir() if path.suffix == _SUFFIX or path.name.startswith(HIDDEN)]
    if len(kept) <= _FILES_AT_MOST:
        return
    used_s: dict[Path, float] = {}
    for path in kept:
        with suppress(OSError):  # another process was faster
            used_s[path] = path.stat().st_mtime
    for path in sorted(used_s, key=lambda each: used_s[each])[: len(kept) - _FILES_AT_MOST]:
        path.unlink(missing_ok=True)
