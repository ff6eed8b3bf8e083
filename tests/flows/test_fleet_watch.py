"""A deployment in the terminal: a row a robot, until it ends."""

import io
from pathlib import Path

from rich.console import Console

from flows.fleet_watch import deployment_table, watch_deployment
from tasks.deploy.describe import describe_deployment_job
from tasks.deploy.fleets import create_fleet
from tasks.deploy.steering import steer, wish_of
from tasks.storage.records import advance
from tasks.storage.store import Store
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
    assert any("Succeeded: 1 Failed, 2 InSync" in line for line in lines)
    assert any("r1" in line and "Failed" in line and "PreLaunchFileFailure" in line for line in lines)
    assert sum("InSync" in line and "Finished" in line for line in lines) == 2


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

    def pause(ended: int, _robots: int) -> None:
        if ended == 1:
            job = robots.asked()[0].deployment
            for wish in ("pause", "go"):
                steer(file_store, job, wish)  # pyright: ignore[reportArgumentType] - one of the two
                titles.append(
                    str(deployment_table(describe_deployment_job(file_store, job), wish_of(file_store, job)).title)
                )

    run(yard, robots, yard.request(version, "one"), version.digest, pause)
    assert ["paused" in title for title in titles] == [True, False]
