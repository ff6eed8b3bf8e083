"""Folders of tests that another account can get to: pytest makes its own for this account alone."""

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def open_folder() -> Generator[Path]:
    """Makes a folder that every account of this machine can get to, for an agent of root, and removes it."""
    with tempfile.TemporaryDirectory(prefix="simyard-open-") as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)
