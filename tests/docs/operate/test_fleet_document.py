"""docs/operate/fleet.md: its commands run in their order; its rules are the program's; its figures are there."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import get_args

import pytest

from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import DeploymentConfig, DeploymentJobErrorCode
from tasks.deploy.fleet.fleet_registry import read_fleet, read_reported
from tasks.deploy.fleet.states import RobotProgress
from tasks.deploy.robot.processes import end_all
from tasks.deploy.rollout.observation import standing
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store
from tests.deploy.reach import open_folder
from tests.docs.typed_blocks import blocks_in
from tests.repository import ROOT
from tests.servers.eventually import eventually

DOCUMENT = (ROOT / "docs/operate/fleet.md").read_text()
BASH = ["bash", "-euo", "pipefail", "-c"]
blocks = partial(blocks_in, DOCUMENT)


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder for the owner and the robot, whose programs may have another account."""
    with open_folder() as folder:
        yield folder


@pytest.fixture
def robots_ended(tmp_path: Path) -> Iterator[None]:
    yield
    for name in ("r1", "r2"):
        if (tmp_path / name).is_dir():
            end_all(tmp_path / name)


def test_a_roll_back_reads_as_it_says():
    back = RobotProgress(status="Failed", step="Launching", runs="courier 1", started_at_s=1.0)
    never = RobotProgress(status="Failed", failure_code="RobotDeploymentAborted", runs="courier 1")
    seen = {"couriers-1": back, "couriers-2": back, "couriers-3": never}
    assert blocks("text") == [f"{standing('courier 2', seen)}\n"]


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("robots_ended")
def test_what_it_says_one_types_rolls_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    monkeypatch.chdir(tmp_path)
    url = (tmp_path / "store").as_uri()
    monkeypatch.setenv("SIMYARD_STORE", url)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    (document,), (make,), (agent,) = blocks("yaml"), blocks("sh"), blocks("robot")
    (deploy,), (during,), (after,) = blocks("deploy"), blocks("during"), blocks("after")
    (tmp_path / "wave-by-wave.yaml").write_text(document)

    subprocess.run([*BASH, make], check=True)
    with ExitStack() as running:
        run = running.enter_context(subprocess.Popen([*BASH, deploy], stdout=subprocess.PIPE, stderr=subprocess.STDOUT))
        running.callback(run.kill)
        eventually(lambda: _is_under_way(url))
        steered = subprocess.run([*BASH, during], check=False, capture_output=True, text=True)
        assert steered.returncode == 0, steered.stderr
        for name in ("r1", "r2"):
            started = running.enter_context(subprocess.Popen([*BASH, f"exec {agent.replace('r1', name)}"]))
            running.callback(started.terminate)
        told, _ = run.communicate()
        assert run.returncode == 0, told.decode()
        done = subprocess.run([*BASH, after], check=False, capture_output=True, text=True)

    assert done.returncode == 0, done.stderr
    assert "no robot of couriers failed" in done.stdout
    assert "all robots of couriers are in sync" in done.stdout
    reports = [read_reported(open_store(url), name) for name in ("r1", "r2")]
    assert [each and each.status for each in reports] == ["InSync", "InSync"]


def _is_under_way(url: str) -> bool:
    time.sleep(0.2)
    store = open_store(url)
    job = read_fleet(store, "couriers").deployment
    return bool(job) and read(store, "deployment-job", job).status == "InProgress"


def test_its_rules_are_the_programs() -> None:
    table = DOCUMENT.split("| rule |")[1].split("\n\n")[0]
    rules = re.findall(r"^\| `([^`]+)`", table, flags=re.MULTILINE)

    known = {*DeploymentConfig.model_fields, *(f"rollOut.{name}" for name in RollOutRules.model_fields)}
    assert set(rules) == known


def test_every_failure_code_that_a_robot_or_a_deployment_can_have_is_explained() -> None:
    sources = (path.read_text() for path in sorted((ROOT / "tasks/deploy").rglob("*.py")))
    used = {code for text in sources for code in re.findall(r'"([A-Za-z]+)"', text)} & set(
        get_args(DeploymentJobErrorCode)
    )
    tables = "".join(re.findall(r"^\| (`[A-Z].*?) \|", DOCUMENT.split("### Failure codes")[1], flags=re.MULTILINE))

    assert set(re.findall(r"`([A-Z][A-Za-z]+)`", tables)) == used


def test_every_command_that_it_names_is_one() -> None:
    named = {tuple(each.split()) for each in re.findall(r"simyard ((?:fleet )?[a-z-]+)", DOCUMENT)}
    from flows.cli.shell import COMMANDS, load  # noqa: PLC0415 - the command line alone needs it

    commands = {(name,) for name in [*COMMANDS, "agent"]} | {("fleet", name) for name in load("fleet").commands}
    assert not named - commands


def test_every_promise_has_a_test_and_figures() -> None:
    promised = re.findall(r"^(\d)\. \*\*", DOCUMENT, flags=re.MULTILINE)
    modules = {path.name[5] for path in (ROOT / "tests/deploy/promises").glob("test_[0-9]*.py")}
    assert set(promised) == modules
    figures = DOCUMENT.split("<!-- promises -->")[1].split("<!-- end of promises -->")[0]
    assert set(re.findall(r"^\| (\d) ", figures, flags=re.MULTILINE)) == modules
