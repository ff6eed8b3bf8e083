"""What an agent of another account lacks in a folder store is known before it has anything to report."""

import os
import subprocess
import sys

from tasks.deploy.fleet.fleet_registry import create_robot
from tasks.deploy.robot.account import missing_rights, silence_note
from tasks.storage.store_url import open_store
from tests.deploy.reach import open_folder
from tests.storage.two_accounts import as_two_accounts

AS_NOBODY = """
import os, sys
from tasks.deploy.robot.account import missing_rights
from tasks.storage.store_url import connect
store = connect(sys.argv[1])
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
print(*missing_rights(store, "r1"), sep="\\n")
"""


@as_two_accounts
def test_an_agent_of_another_account_lacks_two_rights_and_its_owner_none():
    before = os.umask(0o022)
    try:
        with open_folder() as folder:
            store = open_store((folder / "store").as_uri())
            create_robot(store, "r1")
            store.put("robots/r1/desired.json", b"1")
            ended = subprocess.run(
                [sys.executable, "-c", AS_NOBODY, store.url], capture_output=True, text=True, check=True
            )
            told = [line.partition(", which")[0] for line in ended.stdout.splitlines()]
            places = [f"{folder}/store/robots/r1", f"{folder}/store/.locks"]
            assert told == [f"nobody may not write in {place}" for place in places]
            assert list(missing_rights(store, "r1")) == []
            note = silence_note(store, "r1")
            assert f"only root may write in {places[0]} and only root may write in {places[1]}" in note
    finally:
        os.umask(before)
