"""A version holds a bundle for each architecture, and the gate's PASS is about those that were driven alone.

That a stand-in which the document names by its digest cannot be exchanged either is in
tests/results/gate/test_shipped_builds.py: commit d54b1a2 knows no stand-ins.
"""

import time
from pathlib import Path

import pytest

from tests.attacks.conftest import Owner, Writer
from tests.attacks.run.small_robots import FLEET, ROBOT, bundle, call_robot, document, done, forge_build, publish

pytestmark = [pytest.mark.integration, pytest.mark.long]
_REFUSED, _NOT_SHIPPED = 2, 1


def _register(owner: Owner) -> None:
    done(owner, "fleet", "create", FLEET)
    done(owner, "fleet", "register", FLEET, ROBOT)


def test_a_build_that_was_added_to_the_version_before_the_run_does_not_ship(
    owner: Owner, writer: Writer, tmp_path: Path
):
    """The writer adds a forged ARM64 build to the version and says that the robot is an ARM64.

    No episode drives the build, and the document names none: refused before anything runs.
    """
    publish(owner, str(bundle(tmp_path / "own")))
    _register(owner)
    forge_build(writer, "ARM64", bundle(tmp_path / "forged", tmp_path / "forged-ran"))
    call_robot(writer, "ARM64")

    ended = owner.simyard("run", document(owner))

    assert not (tmp_path / "forged-ran").exists(), "the forged build runs on the robot"
    assert ended.returncode == _REFUSED, ended.stdout
    assert "deployment.untestedBuilds" in ended.stdout
    assert "for ARM64" in ended.stdout


def test_a_build_that_is_added_while_the_batch_runs_does_not_ship(owner: Owner, writer: Writer, tmp_path: Path):
    """The writer adds a forged ARM64 build to the tested version, and calls the robot an ARM64, while the batch runs.

    What ships was settled before anything ran, and is in the evidence: the deployment is refused.
    """
    publish(owner, str(bundle(tmp_path / "own")))
    _register(owner)
    run = owner.start("run", document(owner))
    try:
        while not writer.keys("jobs/simulation-job-batch/"):
            assert run.poll() is None, run.communicate()[0]
            time.sleep(0.05)
        forge_build(writer, "ARM64", bundle(tmp_path / "forged", tmp_path / "forged-ran"))
        call_robot(writer, "ARM64")
        out, _ = run.communicate(timeout=200)
    finally:
        run.kill()

    assert not (tmp_path / "forged-ran").exists(), "the forged build runs on the robot"
    assert run.returncode == _NOT_SHIPPED, out
    assert "slider version 1 for ARM64 is" in out


def test_a_robot_that_is_said_to_be_another_does_not_get_what_nobody_drove(
    owner: Owner, writer: Writer, tmp_path: Path
):
    """The writer calls a robot an ARM64, for which the version has a build that nobody drove.

    Each build of a version is driven or named, whatever robots there are: refused before anything runs.
    """
    own = bundle(tmp_path / "own")
    untested = bundle(tmp_path / "untested", tmp_path / "untested-ran")
    publish(owner, "--architecture", f"X86_64={own}", "--architecture", f"ARM64={untested}")
    _register(owner)
    call_robot(writer, "ARM64")

    ended = owner.simyard("run", document(owner))

    assert not (tmp_path / "untested-ran").exists(), "the robot runs a build that nobody drove"
    assert ended.returncode == _REFUSED, ended.stdout


def test_a_build_that_the_owner_forgot_to_test_does_not_ship(owner: Owner, tmp_path: Path):
    """The owner herself has ARM64 robots and a build for them, and her batch drives the one for X86_64.

    Refused before anything runs, with the words that drive the build or name it.
    """
    own = bundle(tmp_path / "own")
    untested = bundle(tmp_path / "untested", tmp_path / "untested-ran")
    publish(owner, "--architecture", f"X86_64={own}", "--architecture", f"ARM64={untested}")
    done(owner, "fleet", "create", FLEET)
    done(owner, "fleet", "register", FLEET, ROBOT, "--architecture", "ARM64")

    ended = owner.simyard("run", document(owner))

    assert not (tmp_path / "untested-ran").exists(), "the robot runs a build that nobody drove"
    assert ended.returncode == _REFUSED, ended.stdout
    assert "architecture: ARM64" in ended.stdout
