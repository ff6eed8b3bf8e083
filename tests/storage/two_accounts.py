"""Root's folder store, and an account without rights that works on it."""

import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from tasks.storage.backends.local import LocalStore
from tests.deploy.reach import open_folder

AS_NOBODY = """
import os, sys
from pathlib import Path
from specs.errors import StoreError
from tasks.storage.backends.local import LocalStore
os.umask(0o077)
os.setgroups([int(each) for each in sys.argv[2].split(",") if each])
os.setgid(65534)
os.setuid(65534)
store = LocalStore(Path(sys.argv[1]))
try:
    exec(sys.argv[3])
except StoreError as exc:
    sys.exit(f"{type(exc).__name__}: {exc}")
"""
GROUP = 54321

as_two_accounts = pytest.mark.skipif(
    os.geteuid() != 0 and os.environ.get("CI") != "true", reason="only root can act as two accounts"
)


@contextmanager
def shared_store() -> Generator[LocalStore]:
    """Yields root's store in a folder that everybody can get to, with a robot in it, made under umask 022."""
    before = os.umask(0o022)
    try:
        with open_folder() as folder:
            store = LocalStore(folder / "store")
            store.create("robots/r1/record.json", b"1")
            store.put("robots/r1/desired.json", b"1")  # makes the folder of locks
            yield store
    finally:
        os.umask(before)


def as_nobody(store: LocalStore, work: str, *groups: int) -> str:
    """Returns what an account without rights is told when it does the work; empty for no error."""
    command = [sys.executable, "-c", AS_NOBODY, str(store.root), ",".join(map(str, groups)), work]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "Traceback" not in ended.stderr, ended.stderr
    return ended.stderr.strip()
