"""A secret is in no log, record or report: of a variable, of a key that signs, of a key to the store."""

import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.deploy.fleet.fleet_registry import create_robot, read_reported, register_robot
from tasks.deploy.fleet_descriptions import describe_deployment_job, describe_robot
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.trust.test_keyring import private_forms
from tests.deploy.yard import FLEET, STAYS_UP, Yard, kill, programs_of
from tests.servers.seaweed import ACCESS_KEY, SECRET_KEY

pytestmark = pytest.mark.integration
VARIABLE = "canary-of-a-variable-5ee01"
FILE_SECRET = "canary-of-aws-for-a-folder"  # noqa: S105 - what must not be found
LEAKY = "#!/bin/sh\nexit 3\n"


@pytest.fixture
def agent(yard: Yard, owner: Owner, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[bytes]]:
    """An agent that verifies, with all secrets in its environment."""
    monkeypatch.setenv("SIMYARD_KEYS", str(owner.folder))
    for name in ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"):
        if name not in os.environ and kind(yard.store.url) == "file":
            monkeypatch.setenv(name, FILE_SECRET)
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")
    owner.vouch("r1")
    root = yard.root("r1")
    root.mkdir(parents=True)
    options = {"robot": "r1", "root": root, "store": yard.store.url, "root-of-trust": owner.folder / "root.json"}
    pace = {"user": os.geteuid(), "poll-s": 0.05, "longest-poll-s": 0.1, "grace-s": 0.2}
    argv = [f"--{name}={value}" for name, value in {**options, **pace}.items()]
    with (root / "agent.log").open("ab") as log:
        started = subprocess.Popen([sys.executable, "-m", "tasks.deploy.robot.agent", *argv], stdout=log, stderr=log)
    yield started
    kill(started)


@sizes(short=1, long=5)
def test_no_secret_is_told(
    yard: Yard,
    owner: Owner,
    agent: subprocess.Popen[bytes],
    *,
    size: int,
    figures: Figures,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)  # as agents and controllers have it; botocore tells whole requests below that
    caplog.set_level(logging.DEBUG, logger="tasks")
    version = yard.publish({"run.sh": STAYS_UP, "fail.sh": LEAKY})
    told: list[str] = []
    for number, launch in enumerate(({}, {"preLaunchFile": "fail.sh"}, {"launchFile": "none.sh"}) * size):
        request = yard.request(version, f"run-{number}", environmentVariables={"TOKEN": VARIABLE}, **launch)
        record = run_deployment_job(
            yard.store,
            request,
            digest=version.digest,
            token=request.clientRequestToken,
            progress=lambda *_: None,
            signer=owner.signer,
        )
        reported = read_reported(yard.store, "r1")
        assert reported is not None
        told += [reported.model_dump_json(), record.failure_reason, describe_robot(yard.store, "r1").model_dump_json()]
        summary = describe_deployment_job(yard.store, record.id).robotDeploymentSummary or ()
        told += [robot.model_dump_json() for robot in summary]
    assert [each for each in told if "Failed" in each], "failures must have been told, too"
    assert agent.poll() is None
    assert programs_of(yard.root("r1"))

    logs = [path.read_bytes() for path in yard.root("r1").rglob("*.log")]
    kept = [yard.store.get(key).body for key in yard.store.keys("")]
    secrets = [SECRET_KEY, ACCESS_KEY, FILE_SECRET]
    forms = {*private_forms(owner.folder), *(secret.encode() for secret in secrets)}
    everywhere = [*logs, *kept, caplog.text.encode(), "".join(told).encode()]
    assert len(logs) > 1
    assert not [form for form in forms for place in everywhere if form in place]
    # Variables are part of what was asked for, and stand there, in the clear; nobody repeats them.
    assert not [place for place in (*logs, caplog.text.encode(), "".join(told).encode()) if VARIABLE.encode() in place]
    figures(8, kind(yard.store.url), secrets=len(forms) + 1, places=len(everywhere), found=0)
