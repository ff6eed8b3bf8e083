"""The agent as a process of its own: killed, told to end, and what it needs."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from specs.bundle import Version
from specs.deployment import DeploymentLaunchConfig
from specs.errors import DocumentError
from tasks.deploy.agent import Poll, _alone, main
from tasks.deploy.disk import Disk
from tasks.deploy.robots import ask
from tasks.deploy.states import Desired
from tasks.deploy.stopping import Stop, StopRequested
from tests.deploy.yard import STAYS_UP, Yard, eventually, kill, programs_of, wait_for_report

pytestmark = pytest.mark.integration
SLOW = '#!/bin/sh\necho "$0" >> "$HOME/runs"\nsleep 0.15\n'
STEPS = ("DownloadingExtracting", "ExecutingPreLaunch", "Launching", "ExecutingPostLaunch")


@pytest.fixture
def agents(yard: Yard) -> Iterator[list[subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for agent in started:
        kill(agent)


def _ask(yard: Yard, version: Version, deployment: str) -> Desired:
    launch = DeploymentLaunchConfig(
        packageName="courier", preLaunchFile="before.sh", launchFile="run.sh", postLaunchFile="after.sh"
    )
    return ask(
        yard.store,
        Desired(
            robot="r1",
            deployment=deployment,
            sequence=1,
            epoch=1,
            application="courier",
            version=version.number,
            digest=version.digest,
            launch=launch,
            environment={},
            timeout_s=60.0,
            issued_at_s=0.0,
        ),
    )


@pytest.mark.parametrize("step", STEPS)
def test_an_agent_that_is_killed_in_a_step_finishes_after_its_next_start(
    step: str, yard: Yard, agents: list[subprocess.Popen[bytes]]
) -> None:
    old = yard.publish({"run.sh": STAYS_UP, "before.sh": SLOW, "after.sh": SLOW})
    new = yard.publish({"run.sh": STAYS_UP + "# new\n", "before.sh": SLOW, "after.sh": SLOW}, padding_bytes=40 << 20)
    agents.append(yard.start_agent("r1"))
    _ask(yard, old, "dep-old")
    wait_for_report(yard, "r1", lambda reported: reported.status == "InSync")

    _ask(yard, new, "dep-new")
    wait_for_report(yard, "r1", lambda reported: reported.deployment == "dep-new" and reported.step == step)
    kill(agents[0])
    assert yard.current("r1") in {old.digest, new.digest}

    agents.append(yard.start_agent("r1"))
    done = wait_for_report(
        yard, "r1", lambda reported: reported.deployment == "dep-new" and reported.status != "Deploying"
    )
    assert (done.status, done.failure_reason, done.sequence) == ("InSync", "", 2)
    assert yard.current("r1") == new.digest
    assert programs_of(yard.root("r1")) == ["sleep 1000"]
    assert sorted(path.name for path in (yard.root("r1") / "versions").iterdir()) == sorted([old.digest, new.digest])


def test_an_agent_that_is_killed_again_and_again_never_breaks_its_version(
    yard: Yard, agents: list[subprocess.Popen[bytes]]
) -> None:
    scripts = {"run.sh": STAYS_UP, "before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"}
    versions = [yard.publish({**scripts, "run.sh": f"{STAYS_UP}# {number}\n"}) for number in range(4)]
    for number, version in enumerate(versions):
        _ask(yard, version, f"dep-{number}")
        for kills in range(3):
            agent = yard.start_agent("r1")
            agents.append(agent)
            pause = 0.25 + 0.13 * kills + 0.05 * number  # spread over start-up, installation and launch
            try:
                agent.wait(pause)
            except subprocess.TimeoutExpired:
                kill(agent)
            yard.current("r1")

    agents.append(yard.start_agent("r1"))
    done = wait_for_report(
        yard, "r1", lambda reported: reported.deployment == "dep-3" and reported.status != "Deploying"
    )
    assert (done.status, yard.current("r1")) == ("InSync", versions[-1].digest)
    assert programs_of(yard.root("r1")) == ["sleep 1000"]


def test_an_agent_that_is_told_to_end_ends_its_application_and_exits_with_0(
    yard: Yard, agents: list[subprocess.Popen[bytes]]
) -> None:
    version = yard.publish({"run.sh": STAYS_UP, "before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"})
    agents.append(yard.start_agent("r1"))
    _ask(yard, version, "dep-1")
    wait_for_report(yard, "r1", lambda reported: reported.status == "InSync")

    agents[0].send_signal(signal.SIGTERM)

    assert agents[0].wait() == 0
    assert programs_of(yard.root("r1")) == []


def test_a_second_agent_on_a_folder_waits_until_the_first_is_gone(
    yard: Yard, agents: list[subprocess.Popen[bytes]]
) -> None:
    version = yard.publish({"run.sh": STAYS_UP, "before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"})
    agents.append(yard.start_agent("r1"))
    _ask(yard, version, "dep-1")
    first = wait_for_report(yard, "r1", lambda reported: reported.status == "InSync")
    agents.append(yard.start_agent("r1"))

    kill(agents[0])

    wait_for_report(yard, "r1", lambda reported: reported == first)
    eventually(lambda: programs_of(yard.root("r1")) == ["sleep 1000"])
    assert agents[1].poll() is None


class _StopAfterOneWait(Stop):
    def sleep(self, seconds: float) -> None:
        self.request()
        super().sleep(seconds)


def test_a_folder_belongs_to_one_agent_until_it_lets_go(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    with _alone(disk, Stop()), pytest.raises(StopRequested), _alone(disk, _StopAfterOneWait()):
        pass

    with _alone(disk, _StopAfterOneWait()):
        pass


@pytest.mark.parametrize("robot", ["..", "a/b", ""])
def test_an_agent_with_a_name_that_is_none_does_not_start(robot: str, tmp_path: Path) -> None:
    with pytest.raises(DocumentError):
        main([f"--robot={robot}", f"--root={tmp_path}", f"--store={tmp_path.as_uri()}", "--unsigned"])


def test_an_agent_waits_longer_while_nothing_happens_and_never_in_step() -> None:
    poll = Poll(1.0, 8.0, Random(7))  # noqa: S311 - jitter
    idle = [poll.next_s(busy=False) for _ in range(20)]

    assert idle[-1] > 4 * idle[0]
    assert len(set(idle[-5:])) == 5
    assert max(idle) <= 8.0 * 1.25
    assert poll.next_s(busy=True) <= 1.25


def test_an_agent_needs_none_of_the_heavy_packages() -> None:
    heavy = ["jax", "jaxlib", "prefect", "mujoco", "pyarrow", "numpy", "scipy", "typer", "rich", "s3fs"]
    code = f"import sys, tasks.deploy.agent; print([name for name in {heavy} if name in sys.modules])"

    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    assert loaded.strip() == "[]"
