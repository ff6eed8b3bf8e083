"""A deployment in the terminal: a row a robot, until it ends."""

import io
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from flows.cli.fleet_watch import ABANDONED, deployment_table, fleet_notes, next_deployment, watch_deployment
from flows.cli.shell import app
from specs.errors import StageFailed
from specs.robomaker.deployment import DescribeDeploymentJobResponse, RobotDeployment
from tasks.deploy.fleet.fleet_registry import create_fleet, read_reported
from tasks.deploy.fleet_descriptions import DeploymentView, describe_deployment_job, view_deployment
from tasks.deploy.rollout.operator_commands import command_of, steer
from tasks.storage.base.keys import claim_key, reported_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.claim import ClaimWatch
from tasks.storage.jobs.records import JobRecord, advance, read
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def test_every_robot_has_a_row_with_its_status_and_why(file_store: Store, tmp_path: Path) -> None:
    create_fleet(file_store, FLEET)
    yard, robots = Yard(file_store, tmp_path), PuppetRobots(file_store, 3)
    robots.failing = {"r1"}
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, robots, yard.request(version, "one"), version.digest)
    shown = io.StringIO()

    job = watch_deployment(file_store, record.id, Console(file=shown, width=120))

    assert job.status == record.status == "Succeeded"
    lines = shown.getvalue().splitlines()
    assert any("Succeeded: 2 of 3 robots run courier 1 (r0, r2), 1 runs nothing" in line for line in lines)
    assert any("r1" in line and "Failed" in line and "PreLaunchFileFailure" in line for line in lines)
    assert sum("InSync" in line and "Finished" in line for line in lines) == 2


def test_what_a_robot_reports_is_no_markup_and_steers_nothing() -> None:
    reason = "no camera at [/dev/video0] [bold]\x1b[2J\u202e"
    robot = RobotDeployment(arn="arn:simyard:robot:0123456789ab:r1", status="Failed", failureReason=reason)
    job = DescribeDeploymentJobResponse(status="Failed", robotDeploymentSummary=(robot,))
    record = JobRecord.model_construct(failure_reason="")
    shown = io.StringIO()

    Console(file=shown, width=200).print(deployment_table(DeploymentView(job, record, standing="", why="", runs={})))

    assert "no camera at [/dev/video0] [bold][2J" in shown.getvalue()
    assert not set(shown.getvalue()) & set("\x1b\u202e")


def test_it_looks_again_until_the_deployment_ends(file_store: Store, tmp_path: Path) -> None:
    create_fleet(file_store, FLEET)
    yard, robots = Yard(file_store, tmp_path), PuppetRobots(file_store, 3)
    version = yard.publish({"run.sh": STAYS_UP})
    seen: list[str] = []

    def watch(_ended: int, _robots: int) -> None:
        if seen:
            return
        job = robots.asked()[0].deployment

        def end(_seconds: float) -> None:
            seen.append("looked")
            advance(file_store, "deployment-job", job, "Canceled")

        assert watch_deployment(file_store, job, Console(file=io.StringIO()), end).status == "Canceled"

    run(yard, robots, yard.request(version, "one"), version.digest, watch)
    assert seen == ["looked"]


def test_a_paused_deployment_is_shown_as_paused(file_store: Store, tmp_path: Path) -> None:
    create_fleet(file_store, FLEET)
    yard, robots = Yard(file_store, tmp_path), PuppetRobots(file_store, 3)
    version = yard.publish({"run.sh": STAYS_UP})
    titles: list[str] = []
    told: list[str] = []

    def pause(ended: int, _robots: int) -> None:
        if ended == 1:
            job = robots.asked()[0].deployment
            for wish in ("pause", "go"):
                steer(file_store, job, wish)  # pyright: ignore[reportArgumentType] - one of the two
                told.append(CliRunner().invoke(app, ["fleet", "show", FLEET, "--store", file_store.url]).stderr)
                arn = describe_deployment_job(file_store, job).arn or ""
                told.append(CliRunner().invoke(app, ["describe", arn, "--store", file_store.url]).stderr)
                titles.append(
                    str(deployment_table(view_deployment(file_store, job), command_of(file_store, job)).title)
                )

    run(yard, robots, yard.request(version, "one"), version.digest, pause)
    assert ["paused" in title for title in titles] == [True, False]
    assert ["is paused; simyard fleet resume" in line for line in told] == [True, True, False, False]


def deployed(store: Store, folder: Path) -> JobRecord:
    """Returns a deployment to three robots of which the last has gone back to another version since."""
    create_fleet(store, FLEET)
    yard, robots = Yard(store, folder), PuppetRobots(store, 3)
    old, version = yard.publish({"run.sh": STAYS_UP}), yard.publish({"run.sh": f"{STAYS_UP}# better"})
    record = run(yard, robots, yard.request(version, "one"), version.digest)
    for name, digest, status in (("r0", version.digest, "InSync"), ("r2", old.digest, "Failed")):
        reported = read_reported(store, name)
        assert reported
        change = {"running_digest": digest, "status": status}
        store.put(reported_key(name), encode_document(reported.model_copy(update=change)))
    return record


def test_an_ended_deployment_is_shown_as_it_ended_and_who_is_otherwise_since(file_store: Store, tmp_path: Path) -> None:
    record, shown = deployed(file_store, tmp_path), io.StringIO()

    watch_deployment(file_store, record.id, Console(file=shown, width=160))

    assert f"{record.id}, begun at " in shown.getvalue()
    assert ", as it ended at " in shown.getvalue()
    assert "since then r2 is Failed, and runs courier 1" in shown.getvalue()
    (row,) = [line for line in shown.getvalue().splitlines() if "r0" in line]
    assert "courier 2" in row


def test_each_robot_of_a_fleet_is_told_with_what_it_runs(file_store: Store, tmp_path: Path) -> None:
    deployed(file_store, tmp_path)
    assert fleet_notes(file_store, FLEET) == [
        "r0 has courier 2; its agent last reported 0 min ago",
        "r1 has courier 2; its agent last reported 0 min ago",
        "r2 has courier 1; its agent last reported 0 min ago",
        "agents report changes only: whether an agent or its version still runs is not known here",
    ]


def test_the_next_deployment_is_waited_for_and_one_under_way_is_not(file_store: Store, tmp_path: Path) -> None:
    create_fleet(file_store, FLEET)
    yard, robots = Yard(file_store, tmp_path), PuppetRobots(file_store, 2)
    version = yard.publish({"run.sh": STAYS_UP})
    found: list[str] = []
    waited: list[str] = []

    def look(_ended: int, _robots: int) -> None:
        found.append(next_deployment(file_store, FLEET, lambda _seconds: waited.append("under way")))

    first = run(yard, robots, yard.request(version, "one"), version.digest, look)
    assert set(found) == {first.id}
    assert waited == []

    def deploy(_seconds: float) -> None:
        waited.append(run(yard, robots, yard.request(version, "two"), version.digest).id)

    assert [next_deployment(file_store, FLEET, deploy)] == waited


def test_a_deployment_that_nobody_works_on_says_so(file_store: Store, tmp_path: Path) -> None:
    create_fleet(file_store, FLEET)
    yard, robots = Yard(file_store, tmp_path), PuppetRobots(file_store, 3)
    version = yard.publish({"run.sh": STAYS_UP})
    shown, left = io.StringIO(), list[bool]()

    def look(_ended: int, _robots: int) -> None:
        left.append(ClaimWatch(file_store, claim_key("deployment-job", robots.asked()[0].deployment)).is_left())

    robots.dies_after = 1
    with pytest.raises(StageFailed):
        run(yard, robots, yard.request(version, "one"), version.digest, look)
    job = robots.asked()[0].deployment

    def end(_seconds: float) -> None:
        assert ABANDONED.split(":")[0] in shown.getvalue()
        advance(file_store, "deployment-job", job, "Canceled")

    watch_deployment(file_store, job, Console(file=shown, width=160, force_terminal=True), end)
    assert read(file_store, "deployment-job", job).status == "Canceled"
    assert left
    assert not any(left)
