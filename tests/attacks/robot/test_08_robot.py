"""What a robot runs cannot read what its agent knows, and whatever it is given, its agent goes on.

An agent that is not root's: ``tests/deploy/robot/test_account.py``; more archives, files and storms:
``tests/storage/base/test_tar_headers.py``, ``tests/storage/backends/test_local.py``,
``tests/deploy/robot/test_processes.py``.
"""

import os
import signal
import time
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from specs.robomaker.deployment import DeploymentLaunchConfig
from tests.attacks.conftest import Owner, Writer
from tests.attacks.robot.trusting_robot import KEEP, trusting_robot
from tests.attacks.robot.verifying_robot import eventually
from tests.deploy.yard import command_line
from tests.storage.base.test_tar_headers import MALFORMED

_CANARY = "canary-of-the-store"
# Each lives for two milliseconds; the last of them ends by itself.
_STORM = """#!/bin/sh
exec perl -e '$end = time + 20; # simyard-storm
while (time < $end) { fork && exit; select(undef, undef, undef, 0.002) }'
"""


def _before(name: str) -> DeploymentLaunchConfig:
    return DeploymentLaunchConfig(packageName="courier", launchFile="run.sh", preLaunchFile=name)


@pytest.mark.skipif(os.geteuid() != 0, reason="only an agent of root can give its programs another account")
def test_a_program_cannot_read_the_environment_of_its_agent(owner: Owner, writer: Writer, stop_later: KEEP) -> None:
    """An application reads its agent's environment, where the store's credentials are; it has another account."""
    steal = "#!/bin/sh\ntr '\\0' '\\n' < /proc/$PPID/environ\ncat /proc/$PPID/mem\nls -l /proc/$PPID/fd\nexit 0\n"
    with trusting_robot(owner, writer, stop_later, AWS_SESSION_TOKEN_OF_TEST=_CANARY) as robot:
        told = robot.ask({"steal.sh": steal}, launch=_before("steal.sh"))

        assert told.status == "InSync", told.failure_reason
        assert b"denied" in robot.log("pre-launch")
        assert _CANARY.encode() not in robot.log("pre-launch")


@pytest.mark.parametrize("what", ["a length that is too long", "a chain of headers"])
def test_a_malformed_archive_is_refused_and_the_application_runs_on(
    what: str, owner: Owner, writer: Writer, stop_later: KEEP
) -> None:
    """The attacker has a robot unpack an archive whose headers end or hang who reads them; the bundle is refused."""
    with trusting_robot(owner, writer, stop_later) as robot:
        assert robot.ask({}).status == "InSync"
        before = robot.runs

        told = robot.ask({}, bundle=MALFORMED[what] + b"\0" * 1024)

        assert (told.status, told.failure_code) == ("Failed", "ExtractingBundleFailure")
        assert robot.lives
        assert robot.runs == before


def test_a_pipe_in_the_store_keeps_no_agent_from_its_application(
    owner: Owner, writer: Writer, stop_later: KEEP
) -> None:
    """The attacker puts a named pipe where the agent looks; the agent does not wait for it, and keeps things up."""
    if not owner.url.startswith("file:"):
        pytest.skip("a bucket has no pipes")
    with trusting_robot(owner, writer, stop_later) as robot:
        assert robot.ask({}).status == "InSync"
        writer.delete("robots/r1/desired.json")
        os.mkfifo(Path(unquote(urlsplit(owner.url).path)) / "robots/r1/desired.json")
        time.sleep(1.0)  # it looks three times

        (application,) = robot.runs
        os.kill(application, signal.SIGKILL)

        eventually(lambda: robot.runs not in ([], [application]))


def test_what_forks_for_ever_is_ended(owner: Owner, writer: Writer, stop_later: KEEP) -> None:
    """A script forks and exits all the time, faster than one looks at processes; it is stopped, then ended."""
    with trusting_robot(owner, writer, stop_later) as robot:
        told = robot.ask({"storm.sh": _STORM}, launch=_before("storm.sh"), timeout_s=1.0)

        assert told.status == "InSync"  # the script itself has ended well
        assert [line for each in Path("/proc").glob("[0-9]*") if "simyard-storm" in (line := command_line(each))] == []
        assert robot.lives
