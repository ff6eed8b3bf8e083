"""The agent as a process of its own: killed, told to end, and what it needs."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from specs.bundle import Version
from specs.deployment import DeploymentLaunchConfig
from tasks.deploy.robots import ask
from tasks.deploy.states import Desired
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


def test_an_agent_needs_none_of_the_heavy_packages() -> None:
    heavy = ["jax", "jaxlib", "prefect", "mujoco", "pyarrow", "numpy", "scipy", "typer", "rich", "s3fs"]
    code = f"import sys, tasks.deploy.agent; print([name for name in {heavy} if name in sys.modules])"

    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    assert loaded.strip() == "[]"
