"""What robots run: with which variables, for how long, and what is left of it."""

from collections.abc import Mapping

import pytest

from specs.robomaker.bundle import Version
from tasks.applications.registry import publish_bundle
from tests.deploy.one_robot import GOOD, NAME, OneRobot, scripted
from tests.deploy.yard import STAYS_UP
from tests.servers.eventually import eventually


def test_a_file_that_is_not_executable_is_told_with_the_remedy(one: OneRobot) -> None:
    (one.yard.folder / "bundle/courier").mkdir(parents=True)
    (one.yard.folder / "bundle/courier/run.sh").write_text(STAYS_UP)
    version = publish_bundle(one.yard.store, "robot-application", "courier", one.yard.folder / "bundle")

    reported = one.deploy(version, 1)

    assert (reported.failure_code, "chmod +x" in reported.failure_reason) == ("BadPermissionError", True)


_STRANGE_ELF = "\x7fELF\x02\x01\x01" + "\0" * 11 + "\xb7\0" + "\0" * 40


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "#!/bin/sh\r\nexec sleep 9\r\n",
            "line 1: ends in CR LF, and the CR counts to the interpreter's name: dos2unix",
        ),
        ("#!/usr/bin/python2\n", "it needs /usr/bin/python2 (line 1), which this robot does not have"),
        ("exec sleep 9\n", "line 1: says not what runs it: begin it with #!/bin/sh"),
        (_STRANGE_ELF, "it is compiled for ARM64, and this robot is of architecture"),
        ("\0" * 64, "it is damaged, or built for another system than this robot's"),
    ],
)
@pytest.mark.parametrize("step", ["launchFile", "preLaunchFile"])
def test_why_a_file_cannot_be_started_is_told(text: str, said: str, step: str, one: OneRobot) -> None:
    launch = scripted() if step == "launchFile" else scripted(preLaunchFile="first.sh")
    good = one.yard.publish(GOOD)
    one.deploy(good, 1)

    told = one.deploy(_latin(one, {**GOOD, {"launchFile": "run.sh"}.get(step, "first.sh"): text}), 2, launch=launch)

    code = "EnvironmentSetupError" if step == "launchFile" else "PreLaunchFileFailure"
    assert (told.failure_code, told.running_digest, told.is_up) == (code, good.digest, True)
    assert said in told.failure_reason


def _latin(one: OneRobot, files: Mapping[str, str]) -> Version:
    """Publishes a package of executable files with these texts, in Latin-1."""
    package = one.yard.folder / "latin" / "courier"
    package.mkdir(parents=True)
    for name, text in files.items():
        (package / name).write_bytes(text.encode("latin-1"))
        (package / name).chmod(0o755)
    return publish_bundle(one.yard.store, "robot-application", "courier", package.parent)


def test_variables_that_change_which_code_runs_are_refused_by_the_robot_too(one: OneRobot) -> None:
    reported = one.deploy(one.yard.publish(GOOD), 1, environment={"LD_PRELOAD": "/tmp/x.so"})  # noqa: S108 - a value

    assert (reported.failure_code, reported.step) == ("EnvironmentSetupError", "Validating")


def test_a_script_that_hangs_is_ended_with_all_it_started(one: OneRobot) -> None:
    scripts = {**GOOD, "hang.sh": "#!/bin/sh\nsleep 2000 &\nsleep 2000\n"}

    reported = one.deploy(one.yard.publish(scripts), 1, launch=scripted(preLaunchFile="hang.sh"), timeout_s=0.3)

    assert reported.failure_code == "PreLaunchFileFailure"
    assert "longer than 0.3 s" in reported.failure_reason
    assert one.programs == []


def test_a_script_that_leaves_a_daemon_leaves_nothing(one: OneRobot) -> None:
    scripts = {**GOOD, "daemon.sh": "#!/bin/sh\nsetsid sleep 2000 &\n(trap '' TERM; setsid sleep 2001) &\nsleep 0.1\n"}

    reported = one.deploy(one.yard.publish(scripts), 1, launch=scripted(preLaunchFile="daemon.sh"))

    assert (reported.status, one.programs) == ("InSync", ["sleep 1000"])


def test_programs_see_an_environment_made_for_them(one: OneRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "canary")
    scripts = {**GOOD, "env.sh": '#!/bin/sh\nenv > "$HOME/seen"\n'}

    one.deploy(one.yard.publish(scripts), 1, launch=scripted(preLaunchFile="env.sh"), environment={"MAX_SPEED": "1"})

    lines = (one.root / "seen").read_text().splitlines()
    seen = {name: value for name, _, value in (line.partition("=") for line in lines)}
    own = {"SIMYARD_ROBOT", "SIMYARD_DEPLOYMENT", "SIMYARD_ROBOT_ROOT", "SIMYARD_RUN"}
    assert set(seen) <= {"PATH", "LANG", "HOME", "MAX_SPEED", "PWD", "SHLVL", "_"} | own
    assert (seen["MAX_SPEED"], seen["SIMYARD_ROBOT"], seen["SIMYARD_DEPLOYMENT"]) == ("1", NAME, "dep-1")


def test_of_a_long_output_the_beginning_and_the_end_are_kept(one: OneRobot) -> None:
    script = "#!/bin/sh\necho first\nhead -c 3000000 /dev/zero\necho last\n"

    reported = one.deploy(one.yard.publish({**GOOD, "loud.sh": script}), 1, launch=scripted(preLaunchFile="loud.sh"))

    assert reported.status == "InSync"
    log = one.root / "logs" / "000001-pre-launch.log"
    eventually(lambda: log.read_bytes().endswith(b"\0last\n"))
    eventually(lambda: log.stat().st_size < (1 << 19) + 100)
    kept = log.read_bytes()
    said = b"\n[%d bytes are left out here]\n" % (3_000_011 - (1 << 19))
    assert kept.startswith(b"first\n\0")
    assert (kept.index(said), len(kept)) == (1 << 18, (1 << 19) + len(said))


def test_of_a_short_output_everything_is_kept(one: OneRobot) -> None:
    script = "#!/bin/sh\nhead -c 400000 /dev/zero\necho last\n"

    one.deploy(one.yard.publish({**GOOD, "loud.sh": script}), 1, launch=scripted(preLaunchFile="loud.sh"))

    eventually(lambda: (one.root / "logs" / "000001-pre-launch.log").stat().st_size == 400_005)


def test_a_program_whose_output_cannot_be_kept_runs_to_its_end(one: OneRobot) -> None:
    (one.root / "logs" / "000001-pre-launch.log").symlink_to("/dev/full")
    scripts = {**GOOD, "loud.sh": "#!/bin/sh\nhead -c 3000000 /dev/zero\n"}

    assert one.deploy(one.yard.publish(scripts), 1, launch=scripted(preLaunchFile="loud.sh")).status == "InSync"
