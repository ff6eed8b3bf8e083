"""Whole deployments with real agents that verify, and what happens to those that are asked unsigned."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from specs.errors import DocumentError, TrustRefused
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, read_desired, register_robot
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.robot.agent import main
from tasks.deploy.rollout.deployment_job import run_deployment_job, run_sync_job
from tasks.deploy.rollout.resolved_request import plan_sync
from tasks.deploy.trust.signer import DeploymentSigner, chosen_signer, local_signer
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.deploy.one_robot import GOOD
from tests.deploy.trust.signed_fleet import NEWER, Owner
from tests.deploy.yard import FLEET, Yard, kill

pytestmark = [pytest.mark.integration, pytest.mark.long]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    return tmp_path / "cache"


def _deploy(
    yard: Yard, version: Version, token: str, signer: DeploymentSigner | None, root_of_trust: Path | None = None
) -> JobRecord:
    trusting = root_of_trust or (signer.root_of_trust if signer else None)
    return run_deployment_job(
        yard.store,
        yard.request(version, token),
        digest=version.digest,
        token=token,
        progress=lambda *_: None,
        robots=partial(local_agents, yard.store, FLEET, 2, yard.folder / "robots", grace_s=0.2, root_of_trust=trusting),
        signer=signer,
    )


def test_a_fleet_of_this_machine_is_signed_for_with_keys_outside_the_store(yard: Yard, cache: Path) -> None:
    version = yard.publish(GOOD)

    record = _deploy(yard, version, "one", local_signer(yard.store))

    assert record.status == "Succeeded"
    assert str(record.detail["trust"]).startswith("signed by ")
    desired, _ = read_desired(yard.store, f"{FLEET}-1")
    assert desired is not None
    assert desired.signature is not None
    assert list(cache.rglob("deployer-*.pem"))
    assert not list((yard.folder / "store").rglob("*.pem"))


def test_a_fleet_on_s3_is_signed_for(s3_store: Store, tmp_path: Path) -> None:
    yard = Yard(s3_store, tmp_path)
    create_fleet(s3_store, FLEET)
    record = _deploy(yard, yard.publish(GOOD), "one", local_signer(s3_store))

    assert record.status == "Succeeded"


def test_a_machine_that_lost_its_cache_deploys_again(yard: Yard, cache: Path) -> None:
    good, newer = yard.publish(GOOD), yard.publish(NEWER)
    _deploy(yard, good, "one", local_signer(yard.store))
    cache.rename(cache.with_name("lost"))

    assert _deploy(yard, newer, "two", local_signer(yard.store)).status == "Succeeded"
    assert yard.current(f"{FLEET}-1") == newer.digest


def test_a_fleet_is_synced_by_who_signed_what_it_runs(owner: Owner, yard: Yard) -> None:
    record = _deploy(yard, yard.publish(GOOD), "one", owner.signer)
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    owner.vouch("late")
    sync = partial(run_sync_job, yard.store, FLEET, progress=lambda *_: None, signer=owner.signer)
    key = job_key("deployment-job", record.id)
    body = yard.store.get(key).body

    yard.store.put(key, body.replace(b'"launchFile":"run.sh"', b'"launchFile":"evil.s"'))
    with pytest.raises(TrustRefused, match="the plan was changed after it was signed"):
        sync(token="evil")  # noqa: S106 - a client request token
    yard.store.put(key, body)
    request = json.loads(
        json.dumps(record.request).replace('"packageName"', '"environmentVariables": {"X": "evil"}, "packageName"')
    )
    assert plan_sync(yard.store, record.model_copy(update={"request": request})).environments == {"late": {}}
    with local_agents(yard.store, FLEET, 2, yard.folder / "robots", root_of_trust=owner.signer.root_of_trust):
        late = _start(yard, "late", f"--root-of-trust={owner.signer.root_of_trust}")
        try:
            assert sync(token="sync").status == "Succeeded"  # noqa: S106 - a client request token
        finally:
            kill(late)


def test_what_was_deployed_unsigned_is_not_synced_with_keys(owner: Owner, yard: Yard) -> None:
    _deploy(yard, yard.publish(GOOD), "one", None)

    with pytest.raises(TrustRefused, match="is not signed; make a new deployment"):
        run_sync_job(yard.store, FLEET, token="sync", progress=lambda *_: None, signer=owner.signer)  # noqa: S106


@pytest.fixture
def agents() -> Iterator[list[subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for agent in started:
        kill(agent)


def test_an_agent_that_verifies_nothing_says_so(yard: Yard, agents: list[subprocess.Popen[bytes]]) -> None:
    agents.append(_start(yard, "r1", "--unsigned"))
    version = yard.publish(GOOD)
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")
    yard.deploy(version, "one")

    agents[0].send_signal(signal.SIGTERM)
    agents[0].wait()
    assert "UNSIGNED: r1 runs whatever anybody writes" in (yard.root("r1") / "agent.log").read_text()


@pytest.mark.parametrize("trust", [[], ["--unsigned", "--root-of-trust=any"]])
def test_an_agent_is_told_whether_to_verify(trust: list[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--robot=r1", f"--root={tmp_path}", f"--store={tmp_path.as_uri()}", *trust])


def test_a_root_of_trust_that_is_not_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--robot=r1", f"--root={tmp_path}", f"--store={tmp_path.as_uri()}", f"--root-of-trust={tmp_path}/none"])
    assert "argument --root-of-trust: cannot be read" in capsys.readouterr().err


def test_robots_elsewhere_are_not_asked_unsigned_unless_somebody_says_so(
    file_store: Store, owner: Owner, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DocumentError, match="simyard fleet keys init --keys DIR, then SIMYARD_KEYS=DIR"):
        chosen_signer(file_store, "signed", local=False)
    assert chosen_signer(file_store, "unsigned", local=False) is None
    monkeypatch.setenv("SIMYARD_KEYS", str(owner.folder))
    for local in (False, True):
        chosen = chosen_signer(file_store, "signed", local=local)
        assert chosen is not None
        assert chosen.root_of_trust == owner.folder / "root.json"
    monkeypatch.setenv("SIMYARD_KEYS", str(owner.folder / "nothing"))
    with pytest.raises(DocumentError, match="a folder that simyard fleet keys init"):
        chosen_signer(file_store, "signed", local=True)


def _start(yard: Yard, robot: str, trust: str) -> subprocess.Popen[bytes]:
    root = yard.root(robot)
    root.mkdir(parents=True, exist_ok=True)
    pace = ["--poll-s=0.05", "--longest-poll-s=0.1", "--grace-s=0.3", f"--user={os.geteuid()}"]
    argv = [
        "-m",
        "tasks.deploy.robot.agent",
        f"--robot={robot}",
        f"--root={root}",
        f"--store={yard.store.url}",
        trust,
        *pace,
    ]
    with (root / "agent.log").open("ab") as log:
        return subprocess.Popen([sys.executable, *argv], stdout=log, stderr=log, env={**os.environ})
