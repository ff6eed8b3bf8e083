"""A cancelled deployment is withdrawn with the keys that are here, and what they have signed is kept from expiring."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from flows.resources.fleet_membership import renew_metadata_here, withdrawal_note
from specs.errors import DocumentError
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.rollout.deployment_job import run_deployment_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD
from tests.deploy.puppets import PuppetRobots
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import FLEET, Yard


@pytest.fixture
def yard(tmp_path: Path) -> Yard:
    store = open_store((tmp_path / "store").as_uri())
    create_fleet(store, FLEET)
    return Yard(store, tmp_path)


@pytest.fixture
def owner(yard: Yard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Owner:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("SIMYARD_KEYS", str(tmp_path / "keys"))
    return Owner(yard.store, tmp_path / "keys")


@pytest.fixture
def deployed(yard: Yard, owner: Owner) -> JobRecord:
    robots, version = PuppetRobots(yard.store, 1), yard.publish(GOOD)
    owner.vouch("r0")
    return run_deployment_job(
        yard.store,
        yard.request(version, "one"),
        digest=version.digest,
        token="one",  # noqa: S106 - a client request token
        progress=lambda *_: None,
        pace=robots.pace,
        signer=owner.signer,
    )


def _cancel(store: Store, job: JobRecord) -> Result:
    return CliRunner().invoke(app, ["cancel", job.arn, "--store", store.url], catch_exceptions=False)


def test_a_deployment_that_has_ended_is_withdrawn_once(yard: Yard, owner: Owner, deployed: JobRecord) -> None:
    told = _cancel(yard.store, deployed)

    assert f"{deployed.id} is withdrawn; a robot that has seen nothing newer may accept it" in told.stderr
    assert owner.signer.fleets().fleet_of(deployed.id) is None
    with pytest.raises(DocumentError, match="a deployment that is under way; this one is Succeeded"):
        _cancel(yard.store, deployed)


def test_without_keys_nothing_that_has_ended_is_withdrawn(
    yard: Yard, owner: Owner, deployed: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SIMYARD_KEYS")

    with pytest.raises(DocumentError, match="this one is Succeeded"):
        _cancel(yard.store, deployed)

    assert owner.signer.fleets().fleet_of(deployed.id) == FLEET


def test_keys_of_another_store_are_left_alone(yard: Yard, owner: Owner, tmp_path: Path) -> None:
    other = open_store((tmp_path / "other").as_uri())

    assert renew_metadata_here(other) == ()


def test_who_reaps_renews_what_is_due(yard: Yard, owner: Owner) -> None:
    owner.clock.days = -0.6
    owner.renew()
    before = yard.store.get(owner.latest("timestamp")).body

    CliRunner().invoke(app, ["reap", "--store", yard.store.url], catch_exceptions=False)

    assert yard.store.get(owner.latest("timestamp")).body != before


def test_what_no_robot_accepts_any_more_has_no_window() -> None:
    assert withdrawal_note("dep-1", 0.0) == "dep-1 is withdrawn; no robot accepts it any more"
