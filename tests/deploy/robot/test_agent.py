"""The agent as a process: killed, stopped, alone in its folder, with a store that is away."""

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from specs.errors import DocumentError
from specs.robomaker.bundle import Version
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot
from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.agent import Poll, _lock_folder_alone, _warn_if_unknown, main
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.processes import Stop, StopRequested
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import Store
from tests.deploy.one_robot import desired, scripted
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import FLEET, STAYS_UP, Yard, kill, marked_by, programs_of, wait_for_report
from tests.repository import ROOT
from tests.servers.eventually import eventually
from tests.servers.faulty_proxy import faulty_proxy
from tests.servers.seaweed import Seaweed

pytestmark = pytest.mark.integration
SLOW = '#!/bin/sh\necho "$0" >> "$HOME/runs"\nsleep 0.15\n'
STEPS = ("DownloadingExtracting", "ExecutingPreLaunch", "Launching", "ExecutingPostLaunch")
HEAVY = [
    "jax",
    "jaxlib",
    "prefect",
    "mujoco",
    "pyarrow",
    "numpy",
    "scipy",
    "typer",
    "rich",
    "s3fs",
    "fsspec",
    "aiohttp",
    "aiobotocore",
    "httpx",
    "boto3",
    "asyncio",
]
_LARGE_BYTES = 40 << 20


def test_a_robot_that_the_store_does_not_have_is_told_with_the_store(
    file_store: Store, caplog: pytest.LogCaptureFixture
):
    _warn_if_unknown(file_store, "r1")
    assert f"no robot r1 in the store {file_store.url}" in caplog.text


def test_a_registered_robot_needs_no_warning(file_store: Store, caplog: pytest.LogCaptureFixture):
    create_robot(file_store, "r1")
    with caplog.at_level(logging.INFO):
        _warn_if_unknown(file_store, "r1")
    assert not caplog.text


@pytest.fixture
def agents(yard: Yard) -> Iterator[list[subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for agent in started:
        kill(agent)


def _ask(yard: Yard, version: Version, deployment: str) -> Desired:
    launch = scripted(preLaunchFile="before.sh", postLaunchFile="after.sh")
    return ask_robot(yard.store, desired(version, 1, deployment=deployment, launch=launch, timeout_s=60.0))


@pytest.mark.long
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
    eventually(lambda: programs_of(yard.root("r1")) == ["sleep 1000"])
    assert sorted(path.name for path in (yard.root("r1") / "versions").iterdir()) == sorted([old.digest, new.digest])


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
    with _lock_folder_alone(disk, Stop()), pytest.raises(StopRequested), _lock_folder_alone(disk, _StopAfterOneWait()):
        pass

    with _lock_folder_alone(disk, _StopAfterOneWait()):
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


@pytest.fixture
def robots_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a robot has: no boto3, which these tests have, and which the library of signed metadata would import."""
    packages = tmp_path / "packages"
    packages.mkdir()
    (packages / "boto3.py").write_text('raise ImportError("no robot has it")\n')
    monkeypatch.setenv("PYTHONPATH", f"{packages}{os.pathsep}{ROOT}")


@pytest.mark.usefixtures("robots_packages")
@pytest.mark.parametrize(
    "module", ["tasks.deploy.robot.agent", "tasks.storage.backends.s3", "tasks.deploy.trust.verification"]
)
def test_an_agent_needs_none_of_the_heavy_packages(module: str) -> None:
    code = f"import sys, {module}; print([name for name in {HEAVY} if name in sys.modules])"

    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    assert loaded.strip() == "[]"


@pytest.mark.long
@pytest.mark.usefixtures("robots_packages")
def test_an_agent_holds_no_bundle_in_memory(
    file_store: Store, tmp_path: Path, agents: list[subprocess.Popen[bytes]]
) -> None:
    create_fleet(file_store, FLEET)
    yard = Yard(file_store, tmp_path)
    owner = Owner(file_store, tmp_path / "keys")
    small = yard.publish({"run.sh": STAYS_UP})
    large = yard.publish({"run.sh": STAYS_UP}, padding_bytes=_LARGE_BYTES)
    agents.append(yard.start_agent("r1", f"--root-of-trust={owner.folder / 'root.json'}"))
    peaks: list[int] = []
    for number, version in enumerate((small, large), start=1):
        owner.admit(version, f"dep-{number}")
        wanted = desired(version, number, deployment=f"dep-{number}", timeout_s=60.0)
        asked = ask_robot(file_store, wanted, owner.signer.sign)
        wait_for_report(
            yard, "r1", lambda told, asked=asked: (told.sequence, told.status) == (asked.sequence, "InSync")
        )
        peaks.append(_peak_bytes(agents[0]))

    assert peaks[1] - peaks[0] < _LARGE_BYTES / 2


def _peak_bytes(agent: subprocess.Popen[bytes]) -> int:
    """The most memory that a process has had resident."""
    lines = Path(f"/proc/{agent.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024


def test_an_agent_outlives_garbage_and_takes_what_comes_after_it(
    yard: Yard, agents: list[subprocess.Popen[bytes]]
) -> None:
    log = yard.root("r1") / "agent.log"
    yard.store.put(desired_key("r1"), b"{")
    agents.append(yard.start_agent("r1"))
    eventually(lambda: log.exists() and "r1 is without news" in log.read_text())
    time.sleep(1.0)  # ten looks
    _ask(yard, yard.publish({"run.sh": STAYS_UP, "before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"}), "dep-1")

    wait_for_report(yard, "r1", lambda reported: reported.status == "InSync")

    assert log.read_text().count("without news") == 1
    assert "UNSIGNED: r1 runs whatever anybody writes" in log.read_text()


@pytest.mark.long
def test_an_agent_waits_quietly_for_a_store_that_is_away_and_keeps_its_application_up(
    s3_store: Store, seaweed: Seaweed, tmp_path: Path, agents: list[subprocess.Popen[bytes]]
) -> None:
    create_fleet(s3_store, FLEET)
    yard, log = Yard(s3_store, tmp_path), tmp_path / "robots" / "r1" / "agent.log"
    scripts = {"run.sh": STAYS_UP, "before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"}
    with faulty_proxy(seaweed.endpoint) as proxy:
        agents.append(yard.start_agent("r1", "--unsigned", AWS_ENDPOINT_URL_S3=proxy.endpoint))
        _ask(yard, yard.publish(scripts), "dep-1")
        wait_for_report(yard, "r1", lambda reported: reported.status == "InSync")
        (running,) = marked_by(yard.root("r1"))
        proxy.refuse()
        eventually(lambda: "cannot learn what is desired" in log.read_text())
        os.kill(running, signal.SIGKILL)
        eventually(lambda: marked_by(yard.root("r1")) not in ([], [running]))
        _ask(yard, yard.publish({**scripts, "run.sh": STAYS_UP + "# new\n"}), "dep-2")
        proxy.accept()

        wait_for_report(yard, "r1", lambda reported: (reported.deployment, reported.status) == ("dep-2", "InSync"))

    assert log.read_text().count("cannot learn") == 1
    assert log.read_text().count("can learn what is desired again") == 1
