"""Disks of a few megabytes, for tests that fill them: mounted in memory, so only where the tests run as root."""

import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def small_disk(folder: Path, size_kib: int) -> Generator[Path]:
    """Yields the folder, newly made, on a disk of its own; skips the test where nothing may be mounted."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size_kib}k", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("only root may mount a small disk here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def set_size(folder: Path, size_kib: int) -> None:
    """Gives a small disk another size; what is on it stays."""
    subprocess.run(["mount", "-o", f"remount,size={size_kib}k", str(folder)], check=True)


def set_writable(folder: Path, *, writable: bool) -> None:
    """Mounts a small disk read-only, or read-write again."""
    subprocess.run(["mount", "-o", f"remount,{'rw' if writable else 'ro'}", str(folder)], check=True)
