"""docs/operate/fleet-trust.md: what it tells one to type, typed; its table of keys is the program's."""

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.robot.processes import end_all
from tasks.deploy.trust.repository import LIFETIMES
from tasks.storage.store_url import open_store
from tests.deploy.reach import open_folder
from tests.docs.typed_blocks import blocks_in
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/operate/fleet-trust.md").read_text()
BASH = ["bash", "-euo", "pipefail", "-c"]
blocks = partial(blocks_in, DOCUMENT)


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder for the owner and the robot, whose programs may have another account."""
    with open_folder() as folder:
        yield folder


@pytest.fixture
def robot_ended(tmp_path: Path) -> Iterator[None]:
    yield
    if (tmp_path / "robot").is_dir():
        end_all(tmp_path / "robot")


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("robot_ended")
def test_what_it_says_one_types_gives_a_robot_that_runs_what_was_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    monkeypatch.chdir(tmp_path)
    url = (tmp_path / "store").as_uri()
    monkeypatch.setenv("SIMYARD_STORE", url)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    (document,), (make, *rest), (agent,) = blocks("yaml"), blocks("sh"), blocks("robot")
    (vouch,), (restore,) = blocks("vouch"), blocks("restore")
    (tmp_path / "by-hand.yaml").write_text(document)

    subprocess.run([*BASH, make], check=True)
    with subprocess.Popen([*BASH, f"exec {agent}"]) as running:
        done = subprocess.run([*BASH, "".join(rest)], check=False, capture_output=True, text=True)
        running.terminate()
    monkeypatch.setenv("SIMYARD_KEYS", "keys")
    vouched = subprocess.run([*BASH, vouch + restore], check=False, capture_output=True, text=True, input="y\n")

    assert vouched.returncode == 0, vouched.stderr
    assert "+ r1" in vouched.stdout
    assert done.returncode == 0, done.stderr
    assert "UNSIGNED" not in done.stdout
    reported = read_reported(open_store(url), "r1")
    assert reported is not None
    assert reported.status == "InSync"
    assert [line for line in done.stdout.splitlines() if line.startswith("deployer ")]


def test_its_table_of_keys_is_the_programs() -> None:
    table = DOCUMENT.split("| key | says")[1].split("\n\n")[0]
    rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]

    assert {role: days for role, _, days, _ in rows} == {
        role: f"{lifetime.days} day{'s' * (lifetime.days > 1)}" for role, lifetime in LIFETIMES.items()
    }
