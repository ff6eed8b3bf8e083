"""docs/operate/robot.md: what it tells one to type, typed; the robot is a folder, its agent what the unit starts."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Reported
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.processes import end_all
from tasks.storage.backends.local import LocalStore
from tasks.storage.store_url import open_store
from tests.deploy.kit.robot_image import command, environment, install
from tests.deploy.reach import open_folder
from tests.docs.typed_blocks import blocks_in
from tests.repository import ROOT
from tests.servers.tools import need_tool
from tests.storage.two_accounts import GROUP, as_nobody, as_two_accounts, shared_store

DOCUMENT = (ROOT / "docs/operate/robot.md").read_text()
STATE = "image/var/lib/simyard/r1"
blocks = partial(blocks_in, DOCUMENT)


class Owner:
    """Somebody who types, in one terminal after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.url = (folder / "store").as_uri()
        self.variables = {
            **os.environ,
            "SIMYARD_STORE": self.url,
            "SIMYARD_KEYS": "keys",
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        }

    def types(self, block: str) -> int:
        shell = ["bash", "-euo", "pipefail", "-c", block]
        return subprocess.run(shell, check=False, cwd=self.folder, env=self.variables).returncode

    def robot(self) -> Reported:
        reported = read_reported(open_store(self.url), "r1")
        assert reported is not None
        return reported


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder for the owner and the robot, whose programs may have another account."""
    with open_folder() as folder:
        yield folder


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[Owner]:
    yield Owner(tmp_path)
    if (tmp_path / STATE).is_dir():
        end_all(tmp_path / STATE)


@pytest.mark.long
@pytest.mark.integration
def test_a_robots_owner_installs_deploys_breaks_sees_it_go_back_repairs_and_syncs(owner: Owner) -> None:
    (document,), (set_up, bundle, deploy, spoil, repair), (failing,) = blocks("yaml"), blocks("sh"), blocks("fails")
    (owner.folder / "guide.yaml").write_text(document)
    assert owner.types(set_up) == 0
    install(owner.folder / "kit", owner.folder / "image", "r1")
    assert blocks("robot") == ["cd kit\nsudo ./install.sh r1\n"]

    with subprocess.Popen(command(owner.folder / "image", "r1"), env=environment(owner.folder / "image")) as agent:
        assert owner.types(bundle + deploy) == 0
        first = owner.robot()
        assert owner.types(spoil) == 0
        assert owner.types(failing) == 1
        broken = owner.robot()
        assert owner.types(repair) == 0
        repaired = owner.robot()
        modules = Path(f"/proc/{agent.pid}/maps").read_text()
        agent.terminate()

    assert (first.status, broken.status, repaired.status) == ("InSync", "Failed", "InSync")
    assert broken.running_digest == first.running_digest != repaired.running_digest
    assert not re.search(r"jaxlib|numpy|mujoco", modules)


@pytest.fixture
def account_store() -> Iterator[LocalStore]:
    with shared_store() as store:
        yield store


@as_two_accounts
@pytest.mark.parametrize("how", ["rights", "acl"])
def test_the_commands_that_share_a_folder_let_the_agents_account_report_and_no_more(
    how: str, account_store: LocalStore
) -> None:
    (block,) = blocks(how)
    if how == "acl":
        need_tool("setfacl", "acl")
    block = re.sub("(?m)^(groupadd|usermod).*\n", "", block).replace("/srv/store", str(account_store.root))
    block = block.replace("chgrp -R robots ", f"chgrp -R {GROUP} ").replace("u:simyard:", "u:nobody:")
    subprocess.run(["bash", "-euc", block.replace("u:alice:", "u:root:")], check=True)
    account_store.create("robots/r2/record.json", b"1")

    for robot in ("r1", "r2"):
        assert as_nobody(account_store, f"store.put('robots/{robot}/reported.json', b'1')", GROUP) == ""
    assert "may not write in" in as_nobody(account_store, "store.put('fleets/guides.json', b'1')", GROUP)


def test_the_table_of_its_disk_names_what_is_there(tmp_path: Path) -> None:
    there = Disk(tmp_path)
    listed = set(re.findall(r"^\| `([\w.]+)/?` \|", DOCUMENT, flags=re.MULTILINE))

    assert {there.versions.name, there.logs.name, there.current.name} <= listed
