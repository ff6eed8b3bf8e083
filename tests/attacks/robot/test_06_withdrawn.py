"""What was withdrawn stays withdrawn, and robots get what is for their fleet: attacks on what was signed once.

The windows that remain, and every order of writes, are tried in tests/deploy/trust/test_withdrawn.py.
"""

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner, Writer

_DESIRED, _REPORTED = "robots/{}/desired.json", "robots/{}/reported.json"
_DOCUMENT = """name: {fleet}-{name}
deployment:
  fleet: {fleet}
  deploymentConfig: {{concurrentDeploymentPercentage: 100}}
  deploymentApplicationConfigs:
    - application: guide
      launchConfig: {{packageName: guide, launchFile: run.sh}}
"""
_PATIENCE_S = 120.0
StopLater = Callable[[subprocess.Popen[str]], subprocess.Popen[str]]


class Signed:
    """An owner with keys, who publishes an application and deploys it to robots elsewhere."""

    def __init__(self, owner: Owner, writer: Writer, stop_later: StopLater) -> None:
        self.owner, self.writer, self.stop_later = owner, writer, stop_later
        self.folders: dict[str, Path] = {}
        self("fleet", "keys", "init")

    def __call__(self, *arguments: str) -> str:
        done = self.owner.simyard(*arguments, SIMYARD_KEYS="keys")
        assert done.returncode == 0, done.stdout
        return done.stdout

    def publish(self, says: str) -> None:
        script = self.owner.folder / "bundle" / "guide" / "run.sh"
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(f"#!/bin/sh\necho {says}\nexec sleep 1000\n")
        script.chmod(0o755)
        self("app", "publish", "guide", "bundle")

    def begin(self, fleet: str, name: str) -> subprocess.Popen[str]:
        """Returns a deployment that has begun, and waits for robots that are off."""
        document = self.owner.folder / f"{fleet}-{name}.yaml"
        document.write_text(_DOCUMENT.format(fleet=fleet, name=name))
        return self.stop_later(self.owner.start("run", document.name, SIMYARD_KEYS="keys"))

    def deploy(self, fleet: str, name: str, robot: str) -> bytes:
        """Returns what is asked of a robot by a deployment, whose process is gone then."""
        before = _get(self.writer, _DESIRED.format(robot))
        run = self.begin(fleet, name)
        _wait(lambda: _get(self.writer, _DESIRED.format(robot)) not in {before, b""} or run.poll() is not None)
        _end(run)
        asked = _get(self.writer, _DESIRED.format(robot))
        assert asked not in {before, b""}, "the robot was asked nothing"
        return asked

    def cancel(self) -> None:
        for key in self.writer.keys("jobs/deployment-job/"):
            job = json.loads(self.writer.get(key))
            if job["status"] in {"Pending", "Preparing", "InProgress"}:
                self("cancel", job["arn"])

    def wake(self, robot: str) -> str:
        """Returns what a robot reports that was off until now, and verifies what it is asked."""
        root = self._folder(robot)
        options = [
            "--robot",
            robot,
            "--root",
            str(root),
            "--store",
            self.owner.url,
            "--root-of-trust",
            "keys/root.json",
        ]
        agent = self.stop_later(self.owner.start("agent", *options, "--poll-s", "0.2", "--longest-poll-s", "0.5"))
        _wait(lambda: self._status(robot) in {"InSync", "Failed"} or agent.poll() is not None)
        return self._status(robot)

    def _folder(self, robot: str) -> Path:
        """Returns the folder of a robot, which the account that its programs run under can get to."""
        if robot not in self.folders:
            self.folders[robot] = Path(tempfile.mkdtemp(prefix="simyard-open-"))
            self.folders[robot].chmod(0o755)
        return self.folders[robot] / robot

    def installed(self, robot: str) -> bool:
        return (self._folder(robot) / "current").is_symlink()

    def _status(self, robot: str) -> str:
        report = _get(self.writer, _REPORTED.format(robot))
        return str(json.loads(report)["status"]) if report else ""


@pytest.fixture
def signed(owner: Owner, writer: Writer, stop_later: StopLater) -> Iterator[Signed]:
    made = Signed(owner, writer, stop_later)
    yield made
    for folder in made.folders.values():
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def guides(signed: Signed) -> Signed:
    """With a fleet of one robot, which is off."""
    signed("fleet", "create", "guides")
    signed("fleet", "register", "guides", "r1")
    signed.publish("old")
    return signed


def test_a_canceled_deployment_that_is_put_back_is_not_installed(guides: Signed, writer: Writer) -> None:
    """Puts back what a robot that is off was asked, after its owner has cancelled it: it is not in force any more."""
    asked = guides.deploy("guides", "one", "r1")
    guides.cancel()
    writer.put(_DESIRED.format("r1"), asked)

    assert guides.wake("r1") == "Failed"
    assert not guides.installed("r1")


def test_a_superseded_deployment_that_is_put_back_is_not_installed(guides: Signed, writer: Writer) -> None:
    """Puts back what a robot that is off was asked before the latest deployment: only the latest is in force."""
    asked = guides.deploy("guides", "one", "r1")
    guides.publish("new")
    guides.deploy("guides", "two", "r1")
    writer.put(_DESIRED.format("r1"), asked)

    assert guides.wake("r1") == "Failed"
    assert not guides.installed("r1")


def test_a_robot_that_a_record_moves_into_a_fleet_is_asked_nothing(guides: Signed, writer: Writer) -> None:
    """Edits a robot's record so that it names another fleet: the keys vouch for who belongs to which fleet."""
    guides("fleet", "create", "keepers")
    guides("fleet", "register", "keepers", "r2")
    key = "robots/r2/record.json"
    writer.put(key, writer.get(key).replace(b'"keepers"', b'"guides"'))

    run = guides.begin("guides", "one")
    _wait(lambda: bool(_get(writer, _DESIRED.format("r2"))) or run.poll() is not None)

    assert not _get(writer, _DESIRED.format("r2"))
    assert "simyard fleet vouch guides" in run.communicate()[0]


def test_a_sync_that_is_pointed_at_another_fleets_job_asks_nobody(guides: Signed, writer: Writer) -> None:
    """Has a fleet's record name another fleet's deployment before a sync: the signed plan says whose it is."""
    guides("fleet", "create", "keepers")
    guides("fleet", "register", "keepers", "r2")
    guides.deploy("keepers", "one", "r2")
    guides.cancel()
    before = writer.get(_DESIRED.format("r2"))
    theirs = json.loads(writer.get("fleets/keepers.json"))["deployment"]
    ours = json.loads(writer.get("fleets/guides.json"))
    writer.put("fleets/guides.json", json.dumps({**ours, "deployment": theirs}).encode())

    sync = guides.stop_later(guides.owner.start("fleet", "sync", "guides", SIMYARD_KEYS="keys"))
    _wait(lambda: writer.get(_DESIRED.format("r2")) != before or sync.poll() is not None)

    assert writer.get(_DESIRED.format("r2")) == before
    assert "keepers" in sync.communicate()[0]


def test_old_metadata_is_not_built_upon_by_an_owner_whose_last_note_was_lost(signed: Signed, writer: Writer) -> None:
    """Puts back older metadata after the owner lost power between its write and its note: a copy was kept before."""
    notes = signed.owner.folder / "keys" / "signer.json"
    noted = notes.read_bytes()
    (key,) = [key for key in writer.keys("trust/") if key.endswith("/timestamp.json")]
    older = writer.get(key)
    signed("fleet", "keys", "renew")
    notes.write_bytes(noted)  # as if the power had failed before it was written
    writer.put(key, older)

    done = signed.owner.simyard("fleet", "keys", "renew", SIMYARD_KEYS="keys")

    assert done.returncode != 0
    assert "simyard fleet keys restore" in done.stdout
    signed("fleet", "keys", "restore")
    assert writer.get(key) != older
    signed("fleet", "keys", "renew")


def _get(writer: Writer, key: str) -> bytes:
    try:
        return writer.get(key)
    except KeyError:
        return b""


def _wait(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + _PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, "it never happened"
        time.sleep(0.1)


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
