"""How the process that runs applications is shut in."""

from pathlib import Path

import pytest

from tasks.simulate.sandbox.confinement import confined_command, confinement, programs_folder


def test_each_set_of_applications_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    assert programs_folder(["a" * 64, "b" * 64]) == programs_folder(["b" * 64, "a" * 64])
    assert programs_folder(["a" * 64]) != programs_folder(["b" * 64])


def test_where_ros_is_may_be_told_and_is_readable_then(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_ROS_PYTHON", "/where/ros/is/bin/python3")
    command = confined_command(["-c", ""], Path("/programs"), [])
    assert confinement().level == "process" or "/where/ros/is" in command


@pytest.mark.parametrize("told", ["/ros/bin", "/home/owner/bin/python3", "bin/python3"])
def test_no_home_becomes_readable_for_it(monkeypatch: pytest.MonkeyPatch, told: str):
    monkeypatch.setenv("HOME", "/home/owner")
    monkeypatch.setenv("SIMYARD_ROS_PYTHON", told)
    command = confined_command(["-c", ""], Path("/programs"), [])
    assert not {"/", "/home/owner", "."}.intersection(command)


@pytest.mark.skipif(confinement().level != "bubblewrap", reason=confinement().why or "there")
def test_what_applications_may_write_is_bounded():
    command = confined_command(["-c", ""], Path("/programs"), [])
    assert int(command[command.index("--size") + 1]) > 0
    assert command[command.index("--size") + 2 :][:2] == ["--tmpfs", "/tmp"]  # noqa: S108 - a new one
