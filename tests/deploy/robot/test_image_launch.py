"""Container images on a robot: the same digest that was tested, run without rights, the old version kept."""

import os
import shutil
from pathlib import Path

import pytest

from specs.robomaker.bundle import Version
from tasks.applications.registry import publish_bundle
from tasks.storage.container_image import image_bundle
from tests.deploy.one_robot import OneRobot, scripted
from tests.deploy.yard import eventually
from tests.storage.made_images import Entry, docker_archive, file, layer, link


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
    names = ("sh", "sleep", "id", "cat")
    programs = [file("bin/busybox", busybox.read_bytes()), *(link(f"bin/{name}", "busybox") for name in names)]
    archive = docker_archive(
        one.yard.folder / "app.tar", [layer(*programs, *more)], {"Env": ["FROM=image"], "User": "7"}
    )
    return publish_bundle(one.yard.store, "robot-application", "courier", image_bundle(str(archive), archive.parent))


def test_an_image_runs_with_its_own_files_and_is_replaced_by_the_next(one: OneRobot, busybox: Path) -> None:
    first = file("courier/run.sh", b'#!/bin/sh\necho "$FROM $(id -u) $SIMYARD_ROBOT" > "$HOME/seen"\nexec sleep 1000\n')
    version = _published(one, busybox, first)
    reported = one.deploy(version, 1)
    assert (reported.status, reported.running_digest) == ("InSync", version.digest), reported.failure_reason
    eventually(lambda: (one.root / "seen").read_text() == f"image 7 {one.root.name}\n")

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
    assert [each for each in one.programs if "1001" in each]
    assert not [each for each in one.programs if "1000" in each]
    assert {path.name for path in (one.root / "images").iterdir()} == {version.digest, second.digest}


def test_a_script_of_an_image_runs_in_it(one: OneRobot, busybox: Path) -> None:
    run, first = (
        file("courier/run.sh", b"#!/bin/sh\nexec sleep 1000\n"),
        file("courier/first.sh", b"#!/bin/sh\nexit 3\n"),
    )
    reported = one.deploy(_published(one, busybox, run, first), 1, launch=scripted(preLaunchFile="first.sh"))
    assert (reported.failure_code, "exited with 3" in reported.failure_reason) == ("PreLaunchFileFailure", True)
