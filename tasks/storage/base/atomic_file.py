"""Local files that appear whole or not at all, also through a power cut.

A file is written under a hidden name in the folder where it will stand, flushed to the disk, and only then given its
name by one link or rename, which is flushed in turn.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from tasks.storage.base.folder_rights import share_file, share_folder

HIDDEN = ".tmp-"
_EVERYBODYS = 0o666


@contextmanager
def hidden_file(folder: Path, mark: str = "", mode: int = _EVERYBODYS) -> Generator[tuple[BinaryIO, Path]]:
    """Makes a file under a hidden name, which begins with ``HIDDEN`` and the mark, and removes that name at the end.

    The caller writes, calls ``flush_to_disk``, and links or renames; a writer that is killed leaves a name that starts
    with a dot, which no store lists.
    """
    make_folder(folder)
    path = folder / f"{HIDDEN}{mark}{uuid4().hex}"
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            if mode == _EVERYBODYS:
                share_file(descriptor, folder)
            yield file, path
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def whole_file(target: Path, mode: int = 0o666) -> Generator[BinaryIO]:
    """Opens a file for writing that replaces ``target`` when the block ends, and leaves it alone when it raises.

    Args:
        target: The file.
        mode: Who may do what with it, less this process's umask, whatever the old file's was.
    """
    with hidden_file(target.parent, mode=mode) as (file, path):
        yield file
        flush_to_disk(file)
        path.replace(target)
    settle_names(target.parent)


def flush_to_disk(file: BinaryIO) -> None:
    """Waits until the file's bytes are on the disk."""
    file.flush()
    os.fsync(file.fileno())


def settle_names(folder: Path) -> None:
    """Waits until the names in the folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Makes the folder and those above it, each settled in the one that holds it."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    try:
        folder.mkdir()
    except FileExistsError:
        if not folder.is_dir():
            raise
    else:
        share_folder(folder)
    settle_names(folder.parent)
