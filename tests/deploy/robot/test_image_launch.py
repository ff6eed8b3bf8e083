"""Container images on a robot: the same digest that was tested, run without rights, the old version kept."""

import os
import shutil
from pathlib import Path

import pytest

from specs.robomaker.bundle import Version
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.robot import processes
from tasks.storage.container_image import image_bundle
from tests.deploy.one_robot import OneRobot, scripted
from tests.deploy.yard import eventually
from tests.storage.made_images import Entry, docker_archive, file, layer, link

_ENDS_WELL = b"""#!/bin/sh
trap 'sleep 0.3; echo > "$HOME/ended"; exit' TERM
echo > "$HOME/up"
while :; do sleep 1; done
"""


@pytest.fixture
def busybox() -> Path:
    """A program that needs no library: all that is in the images of these tests."""
    for program, package in (("bwrap", "bubblewrap"), ("busybox", "busybox-static")):
        if shutil.which(program) is None:
            (pytest.fail if os.environ.get("CI") else pytest.skip)(f"apt-get install {package}")
    return Path(shutil.which("busybox") or "busybox")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))


def _published(one: OneRobot, busybox: Path, *more: Entry) -> Version:
    names = ("sh", "sleep", "id", "ls")
    programs = [file("bin/busybox", busybox.read_bytes()), *(link(f"bin/{name}", "busybox") for name in names)]
    archive = docker_archive(
        one.yard.folder / "app.tar", [layer(*programs, *more)], {"Env": ["FROM=image"], "User": "7"}
    )
    return publish_bundle(one.yard.store, "robot-application", "courier", image_bundle(str(archive), archive.parent))


def test_an_image_runs_with_its_own_files_and_is_replaced_by_the_next(one: OneRobot, busybox: Path) -> None:
    first = file(
        "courier/run.sh",
        b'#!/bin/sh\necho "$FROM $(id -u) $SIMYARD_ROBOT" $(ls "$HOME") > "$HOME/seen"\nexec sleep 1000\n',
    )
    version = _published(one, busybox, first)
    reported = one.deploy(version, 1)
    assert (reported.status, reported.running_digest) == ("InSync", version.digest), reported.failure_reason
    seen = one.root / "home/seen"
    eventually(lambda: seen.is_file() and seen.read_text() == f"image 7 {one.root.name}\n")

    bad = _published(one, busybox, file("courier/other.sh"))
    reported = one.deploy(bad, 2)
    assert (reported.failure_code, reported.running_digest, reported.is_up) == (
        "ExtractingBundleFailure",
        version.digest,
        True,
    )
    assert "the image has no program '/courier/run.sh'" in reported.failure_reason

    second = _published(one, busybox, file("courier/run.sh", b"#!/bin/sh\nexec sleep 1001\n"))
    assert one.deploy(second, 3).running_digest == second.digest
    eventually(lambda: any("sleep 1001" in each for each in one.programs))  # the shell in the image becomes it
    assert not any("sleep 1000" in each for each in one.programs)
    assert {path.name for path in (one.root / "images").iterdir()} == {version.digest, second.digest}


def test_what_runs_in_an_image_is_asked_to_end_and_has_time_to(
    one: OneRobot, busybox: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "_PATIENCE_S", 60.0)
    one.deploy(_published(one, busybox, file("courier/run.sh", _ENDS_WELL)), 1)
    eventually((one.root / "home/up").is_file)
    one.robot.end()
    assert (one.root / "home/ended").is_file()
    assert one.programs == []


def test_a_robot_that_lost_what_runs_images_stays_up_and_says_so(
    one: OneRobot, busybox: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one.deploy(_published(one, busybox, file("courier/run.sh", b"#!/bin/sh\nexec sleep 1000\n")), 1)
    one.robot.end()
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    one.restarted().recover()
    reported = read_reported(one.yard.store, one.root.name)
    assert reported is not None
    assert (reported.status, reported.is_up) == ("InSync", False)


def test_a_script_of_an_image_runs_in_it(one: OneRobot, busybox: Path) -> None:
    run, first = (
        file("courier/run.sh", b"#!/bin/sh\nexec sleep 1000\n"),
        file("courier/first.sh", b"#!/bin/sh\nexit 3\n"),
    )
    reported = one.deploy(_published(one, busybox, run, first), 1, launch=scripted(preLaunchFile="first.sh"))
    assert (reported.failure_code, "exited with 3" in reported.failure_reason) == ("PreLaunchFileFailure", True)
