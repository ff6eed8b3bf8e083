"""The small things on a robot: variables of interpreters, both ends of a log, and who reads the robot's state."""

import pytest

from specs.robomaker.deployment import DeploymentLaunchConfig
from tests.attacks.conftest import Owner, Writer
from tests.attacks.robot.trusting_robot import KEEP, trusting_robot


@pytest.mark.parametrize("name", ["_JAVA_OPTIONS", "PERLLIB", "LUA_INIT", "PHPRC", "OPENSSL_CONF", "GIT_SSH_COMMAND"])
def test_a_variable_from_which_an_interpreter_takes_code_is_refused(
    name: str, owner: Owner, writer: Writer, stop_later: KEEP
) -> None:
    """The attacker has an interpreter load code by a variable; the robot knows it, and does not launch."""
    with trusting_robot(owner, writer, stop_later) as robot:
        told = robot.ask({}, environment={name: "/tmp/x"})  # noqa: S108 - a value

        assert (told.status, told.failure_code) == ("Failed", "EnvironmentSetupError")
        assert name in told.failure_reason


def test_a_flood_does_not_hide_what_was_printed_last(owner: Owner, writer: Writer, stop_later: KEEP) -> None:
    """A program floods its log before it says why it fails; the log keeps both ends, and state.json is the agent's."""
    flood = "#!/bin/sh\necho first\nhead -c 3000000 /dev/zero\necho why it failed\nexit 3\n"
    launch = DeploymentLaunchConfig(packageName="courier", launchFile="run.sh", preLaunchFile="flood.sh")
    with trusting_robot(owner, writer, stop_later) as robot:
        assert robot.ask({"flood.sh": flood}, launch=launch).status == "Failed"

        log = robot.log("pre-launch")
        assert log.startswith(b"first\n")
        assert log.endswith(b"why it failed\n")
        assert b"bytes are left out here" in log
        assert (robot.root / "state.json").stat().st_mode & 0o077 == 0
