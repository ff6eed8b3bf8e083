"""A folder store of another account: which right is missing on which path, and the command that gives it."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.storage.backends.local import LocalStore
from tests.storage.two_accounts import GROUP, as_nobody, as_two_accounts, shared_store

pytestmark = as_two_accounts


@pytest.fixture
def shared() -> Iterator[LocalStore]:
    with shared_store() as store:
        yield store


def share(folder: Path) -> None:
    """Does what the message and docs/operate/robot.md say."""
    os.chown(folder, -1, GROUP)
    folder.chmod(0o2775)


PUT = "store.put('robots/r1/reported.json', b'1')"


def test_the_two_folders_that_an_agent_writes_to_are_named_one_after_the_other(shared: LocalStore):
    told = as_nobody(shared, PUT)
    folder = shared.root / "robots" / "r1"
    assert f"nobody may not write in {folder}, which is root's (rwxr-xr-x, group root)" in told
    assert f"as root: chgrp nogroup {folder} && chmod g+rwxs {folder}" in told
    share(folder)
    told = as_nobody(shared, "store.put('robots/r1/reported.json', b'1')", GROUP)
    assert f"chmod g+rwxs {shared.root / '.locks'}" in told
    share(shared.root / ".locks")
    assert as_nobody(shared, PUT, GROUP) == ""


def test_locks_and_reports_of_either_account_serve_the_other_whatever_their_umasks(shared: LocalStore):
    share(shared.root / "robots" / "r1")
    share(shared.root / ".locks")
    again = "for n in range(3): store.put(f'robots/r1/a{n}.json', b'1')"
    for number in range(3):
        shared.put(f"robots/r1/a{number}.json", b"1")
    for lock in (shared.root / ".locks").iterdir():  # as an older Simyard made them
        lock.chmod(0o644)
    assert as_nobody(shared, again, GROUP) == ""
    (shared.root / ".locks").rename(shared.root / "old-locks")
    (shared.root / ".locks").mkdir()
    share(shared.root / ".locks")
    assert as_nobody(shared, again, GROUP) == ""
    modes = {stat.S_IMODE(each.stat().st_mode) for each in (shared.root / ".locks").iterdir()}
    modes |= {stat.S_IMODE(each.stat().st_mode) for each in (shared.root / "robots/r1").glob("a*.json")}
    assert modes == {0o660}


def test_a_new_folder_in_a_shared_one_is_shared(shared: LocalStore):
    share(shared.root / "robots")
    share(shared.root / ".locks")
    shared.create("robots/r2/record.json", b"1")
    assert as_nobody(shared, "store.put('robots/r2/reported.json', b'1')", GROUP) == ""


def test_a_folder_that_cannot_be_entered_is_named(shared: LocalStore):
    shared.root.parent.chmod(0o700)
    told = as_nobody(shared, "store.get('robots/r1/desired.json')")
    assert f"nobody may not enter {shared.root.parent}" in told
    assert f"as root: chmod o+x {shared.root.parent}" in told


def test_an_object_that_cannot_be_read_is_named(shared: LocalStore):
    desired = shared.root / "robots/r1/desired.json"
    desired.chmod(0o600)
    told = as_nobody(shared, "store.get('robots/r1/desired.json')")
    assert f"nobody may not read {desired}" in told
    assert f"as root: chgrp nogroup {desired} && chmod g+r {desired}" in told


def test_a_folder_without_the_sign_of_a_shared_one_keeps_to_the_umask(shared: LocalStore):
    before = os.umask(0o077)
    shared.put("robots/r1/other.json", b"1")
    os.umask(before)
    assert stat.S_IMODE((shared.root / "robots/r1/other.json").stat().st_mode) == 0o600
