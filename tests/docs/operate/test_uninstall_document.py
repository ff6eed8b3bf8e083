"""docs/guide/uninstall.md: its commands, typed in a home folder of their own; its paths are those that are used."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from tasks.housekeeping.machine import _CACHE, _KEYS
from tests.docs.typed_blocks import blocks_in
from tests.repository import ROOT

PAGE = (ROOT / "docs/guide/uninstall.md").read_text()
blocks = partial(blocks_in, PAGE)


@pytest.mark.long
@pytest.mark.integration
def test_its_commands_leave_nothing_in_a_home_folder_but_the_store(tmp_path: Path) -> None:
    home = tmp_path / "home"
    digest = "0123456789abcdef" * 4
    for name in (
        f"bundles/{digest}/files/robot.xml",
        f"timings/{digest}.json",
        "keys/0123456789ab/root.pem",
        "owner/key",
    ):
        (home / ".cache/simyard" / name).parent.mkdir(parents=True)
        (home / ".cache/simyard" / name).write_text("1")
    for name in (".config/simyard/access-keys", ".aws/models/robomaker/2018-06-29/service-2.json"):
        (home / name).parent.mkdir(parents=True)
        (home / name).write_text("1")
    (home / "work/.simyard").mkdir(parents=True)
    (home / "work/.simyard/store.json").write_text("{}")
    environment = {
        "HOME": str(home),
        "TMPDIR": str(tmp_path),
        "PYTHONPATH": str(ROOT),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    said = ""
    for block in ("simyard up\n", *blocks("sh")):
        shell = ["bash", "-euo", "pipefail", "-c", block]
        done = subprocess.run(shell, cwd=home, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (block, done.stderr)
        said += done.stdout
    assert "Prefect server: process" in said
    assert "would go with --yes" in said
    assert "ended http://127.0.0.1" in said
    assert f"{home}/work/.simyard/store.json" in said
    left = [path.relative_to(home).as_posix() for path in home.rglob("*") if path.is_file()]
    assert [name for name in left if not name.startswith(".prefect/")] == ["work/.simyard/store.json"]


def test_the_table_names_what_the_command_looks_at() -> None:
    rows = PAGE.split("| where |")[1].split("\n\n")[0]
    for word in (
        "programs",
        "bundles",
        "data",
        "engines",
        "timings",
        "nights",
        "lists of jobs",
        "container images",
        "robots of demonstrations",
        *_KEYS,
    ):
        assert word in rows
    assert {each.partition("/")[0] for each in _CACHE} == {
        "programs",
        "bundles",
        "data",
        "engines",
        "timings",
        "trends",
        "lists",
        "images",
        "image-files",
        "agents",
    }


def test_what_it_removes_on_a_robot_is_what_the_installer_puts_there() -> None:
    installer = (ROOT / "tasks/deploy/kit/robot/install.sh").read_text()
    (robot,) = blocks("robot")
    for name in ("/opt/simyard-agent", "/etc/simyard", "/etc/systemd/system"):
        assert name in installer
        assert name in robot
    assert "userdel simyard" in robot
