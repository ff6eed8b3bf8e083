"""Real agents as processes, a whole deployment at a time."""

import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from specs.errors import BundleRefused, ConcurrentDeployment
from tasks.deploy.fleet.fleet_registry import create_robot, members, read_desired, register_robot
from tasks.deploy.fleet_descriptions import describe_deployment_job, describe_fleet, describe_robot
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.jobs.records import JobRecord
from tests.deploy.yard import FLEET, PATIENCE_S, STAYS_UP, Yard, command_line, kill, programs_of, wait_for_report
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.long]
PARENT = """
import sys, time
from pathlib import Path
from tasks.deploy.kit.local_agents import local_agents
from tasks.storage.store_url import open_store
with local_agents(open_store(sys.argv[1]), "couriers", 2, Path(sys.argv[2]), grace_s=0.2):
    print("started", flush=True)
    time.sleep(1000)
"""


def _codes(record: JobRecord) -> Mapping[str, int]:
    return Counter(robot.failure_code or robot.status for robot in recorded_progress(record).values())


def test_five_robots_get_the_version_and_keep_it_running(yard: Yard) -> None:
    scripts = {
        "run.sh": STAYS_UP,
        "before.sh": '#!/bin/sh\necho "$MAX_SPEED" > "$HOME/speed"\n',
        "after.sh": '#!/bin/sh\nuntil [ -s "$HOME/launches" ]; do sleep 0.01; done\ntest "$(cat ~/launches)" = up\n',
    }
    version = yard.publish(scripts)
    with local_agents(yard.store, FLEET, 5, yard.folder / "robots", grace_s=0.3) as robots:
        launch: dict[str, Any] = {
            "preLaunchFile": "before.sh",
            "postLaunchFile": "after.sh",
            "environmentVariables": {"MAX_SPEED": "1"},
        }
        record = yard.deploy(version, "one", **launch)

        assert record.status == "Succeeded"
        eventually(lambda: [programs_of(yard.root(robot)) for robot in robots] == [["sleep 1000"]] * 5)
        assert {yard.current(robot) for robot in robots} == {version.digest}
        assert {(yard.root(robot) / "speed").read_text() for robot in robots} == {"1\n"}

    assert robots == tuple(f"couriers-{number}" for number in range(1, 6))
    assert yard.calls[-1] == (5, 5)
    assert yard.calls == sorted(yard.calls)
    summary = describe_deployment_job(yard.store, record.id).robotDeploymentSummary or ()
    assert [(each.status, each.progressDetail and each.progressDetail.currentProgress) for each in summary] == [
        ("InSync", "Finished")
    ] * 5
    fleet = describe_fleet(yard.store, FLEET)
    assert (fleet.lastDeploymentStatus, fleet.lastDeploymentJob) == ("Succeeded", record.arn)
    assert describe_robot(yard.store, "couriers-3").status == "InSync"
    assert [programs_of(yard.root(robot)) for robot in robots] == [[]] * 5


def test_a_script_that_fails_on_one_robot_fails_that_robot_alone(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP, "before.sh": '#!/bin/sh\ntest "$SIMYARD_ROBOT" != couriers-2\n'})
    with local_agents(yard.store, FLEET, 5, yard.folder / "robots", grace_s=0.2):
        record = yard.deploy(version, "one", preLaunchFile="before.sh")

    assert record.status == "Succeeded"
    assert _codes(record) == {"InSync": 4, "PreLaunchFileFailure": 1}
    assert recorded_progress(record)["couriers-2"].failure_code == "PreLaunchFileFailure"
    assert yard.current("couriers-2") == ""


def test_a_version_that_fails_everywhere_stops_at_the_threshold(yard: Yard) -> None:
    version = yard.publish({"run.sh": "#!/bin/sh\nexit 3\n"})
    with local_agents(yard.store, FLEET, 5, yard.folder / "robots", grace_s=PATIENCE_S):  # it ends when it ends
        record = yard.deploy(version, "one")

    assert (record.status, record.failure_code) == ("Failed", "FailureThresholdBreached")
    failed = _codes(record)["EnvironmentSetupError"]
    assert failed in {2, 3}, "two stop the roll-out, and one more may be in flight then"
    assert _codes(record)["RobotDeploymentAborted"] == 5 - failed
    assert read_desired(yard.store, "couriers-5")[0] is None
    assert f"{failed} of 5 robots failed" in record.failure_reason


def test_a_smaller_demonstration_leaves_robots_out_that_only_a_larger_one_had(yard: Yard) -> None:
    create_robot(yard.store, "couriers-own")
    register_robot(yard.store, FLEET, "couriers-own")
    with local_agents(yard.store, FLEET, 2, yard.folder / "robots"):
        pass
    with local_agents(yard.store, FLEET, 1, yard.folder / "robots"):
        assert [robot.name for robot in members(yard.store, FLEET)] == ["couriers-own", "couriers-1"]


def test_agents_end_with_the_block_also_when_it_raises(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})

    def fail() -> None:
        with local_agents(yard.store, FLEET, 1, yard.folder / "robots", grace_s=0.2):
            yard.deploy(version, "one")
            assert len(_agents(yard.folder)) == 1
            raise BundleRefused("any error")

    with pytest.raises(BundleRefused, match="any error"):
        fail()

    assert programs_of(yard.root("couriers-1")) == []
    assert _agents(yard.folder) == []


def test_agents_of_a_killed_process_end_by_themselves_and_the_next_take_over(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    argv = [sys.executable, "-c", PARENT, yard.store.url, str(yard.folder / "robots")]
    with subprocess.Popen(argv, stdout=subprocess.PIPE) as parent:
        assert parent.stdout
        assert parent.stdout.readline() == b"started\n"
        yard.deploy(version, "one")
        kill(parent)

    with local_agents(yard.store, FLEET, 2, yard.folder / "robots", grace_s=0.2) as robots:
        for robot in robots:
            eventually(lambda robot=robot: programs_of(yard.root(robot)) == ["sleep 1000"])
        eventually(lambda: len(_agents(yard.folder)) == 2)


@pytest.mark.usefixtures("quick_claims")
def test_a_second_deployment_is_refused_and_the_robots_of_the_first_go_on(yard: Yard) -> None:
    wait = '#!/bin/sh\nuntil test -e "$RELEASE"; do sleep 0.05; done\n'
    version = yard.publish({"run.sh": STAYS_UP, "before.sh": wait})
    release = yard.folder / "release"
    launch: dict[str, Any] = {"preLaunchFile": "before.sh", "environmentVariables": {"RELEASE": str(release)}}

    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(yard.deploy, version, "one", agents=2, **launch)
        try:
            wait_for_report(yard, "couriers-1", lambda reported: reported.step == "ExecutingPreLaunch")
            with pytest.raises(ConcurrentDeployment):
                yard.deploy(version, "two", agents=1)
            joined = [robot.name for robot in members(yard.store, FLEET)]
        finally:
            release.touch()

    assert joined == ["couriers-1", "couriers-2"]
    assert _codes(first.result()) == {"InSync": 2}


def test_what_the_next_agent_launched_outlives_the_end_of_a_block(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    root = yard.root("couriers-1")
    with local_agents(yard.store, FLEET, 1, yard.folder / "robots", grace_s=0.2):
        yard.deploy(version, "one")
        assert programs_of(root) == ["sleep 1000"]
        os.kill(_agents(yard.folder)[0], signal.SIGTERM)
        next_ = yard.start_agent("couriers-1")
        eventually(lambda: (root / "launches").read_text() == "up\nup\n")

    try:
        eventually(lambda: programs_of(root) == ["sleep 1000"])
    finally:
        kill(next_)


def test_what_an_agent_that_was_killed_has_left_ends_with_the_block(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    with local_agents(yard.store, FLEET, 1, yard.folder / "robots", grace_s=0.2):
        yard.deploy(version, "one")
        os.kill(_agents(yard.folder)[0], signal.SIGKILL)
        eventually(lambda: programs_of(yard.root("couriers-1")) == ["sleep 1000"])

    assert programs_of(yard.root("couriers-1")) == []


def _agents(folder: Path) -> list[int]:
    lines = {int(process.name): command_line(process) for process in Path("/proc").glob("[0-9]*")}
    return [pid for pid, line in lines.items() if "tasks.deploy.robot.agent" in line and f"--root={folder}" in line]
