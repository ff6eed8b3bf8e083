"""Folders of tests that another account can get to: pytest makes its own for this account alone."""

import os
from pathlib import Path

import pytest


def let_all_enter(folder: Path) -> Path:
    """Returns the folder, which every account of this machine can get to from now on, though perhaps not list."""
    for each in (folder, *folder.parents):
        found = each.stat()
        if found.st_uid == os.geteuid() and found.st_mode & 0o001 == 0:
            each.chmod(found.st_mode & 0o777 | 0o011)
    return folder


@pytest.fixture
def entered_by_all(tmp_path: Path) -> Path:
    """The test's folder, for an agent of root, whose programs run under another account."""
    return let_all_enter(tmp_path)
