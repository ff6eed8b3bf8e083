"""A deployment for a person."""

from pathlib import Path

from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.fleet_descriptions import deployment_sentence, describe_deployment_job, robot_rows
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def deployed(store: Store, folder: Path) -> JobRecord:
    create_fleet(store, FLEET)
    yard, robots = Yard(store, folder), PuppetRobots(store, 3)
    robots.failing = {"r1"}
    version = yard.publish({"run.sh": STAYS_UP})
    return run(yard, robots, yard.request(version, "one"), version.digest)


def test_each_robot_is_a_row_that_says_why_it_failed(file_store: Store, tmp_path: Path) -> None:
    job = describe_deployment_job(file_store, deployed(file_store, tmp_path).id)

    rows = {row["robot"]: row for row in robot_rows(job)}

    assert {name: row["status"] for name, row in rows.items()} == {"r0": "InSync", "r1": "Failed", "r2": "InSync"}
    assert rows["r1"]["why"].startswith("PreLaunchFileFailure")


def test_a_deployment_that_nobody_signed_says_so(file_store: Store, tmp_path: Path) -> None:
    record = deployed(file_store, tmp_path)
    job = describe_deployment_job(file_store, record.id)

    assert deployment_sentence(job, record) == f"Succeeded: 1 Failed, 2 InSync. {UNSIGNED_ALARM}"
    signed = record.model_copy(update={"detail": {**record.detail, "trust": "somebody"}})
    assert deployment_sentence(job, signed) == "Succeeded: 1 Failed, 2 InSync"
