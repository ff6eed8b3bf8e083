"""What the process that runs applications is given: settings of simulations, and a folder for its own programs."""

from pathlib import Path

import pytest

from tasks.simulate.sandbox.confinement import confined_command, confined_environment, confinement, programs_folder

OWN = {
    "PATH": "/usr/bin",
    "LC_ALL": "C",
    "XLA_FLAGS": "--one",
    "JAX_COMPILATION_CACHE_DIR": "/of/the/run",
    "SIMYARD_STEP_LIMIT_S": "3",
    "SIMYARD_ROS_PYTHON": "/where/ros/is/bin/python3",
    "ROS_ROOT": "/where/ros/is/share/ros",
    "SIMYARD_KEYS": "keys",
    "SIMYARD_OWNER_KEY": "key",
    "SIMYARD_STORE": "s3://bucket",
    "AWS_SECRET_ACCESS_KEY": "secret",
    "PREFECT_API_AUTH_STRING": "admin:password",
    "HOME": "/home/owner",
}


def test_keys_credentials_and_addresses_are_left_out_and_settings_are_kept():
    given = confined_environment(OWN, Path("/programs"))
    assert {given[name] for name in ("PATH", "LC_ALL", "XLA_FLAGS", "SIMYARD_STEP_LIMIT_S")} == {
        "/usr/bin",
        "C",
        "--one",
        "3",
    }
    assert not given.keys() & {name for name in OWN if name.startswith(("AWS_", "PREFECT_"))}
    assert not given.keys() & {"SIMYARD_KEYS", "SIMYARD_OWNER_KEY", "SIMYARD_STORE"}
    assert given["HOME"] != OWN["HOME"]


@pytest.mark.parametrize(("own", "given"), [({}, "disable"), ({"MUJOCO_GL": "egl"}, "egl")])
def test_mujoco_loads_nothing_to_draw_with_unless_told_to(own: dict[str, str], given: str):
    assert confined_environment({**OWN, **own}, Path("/programs"))["MUJOCO_GL"] == given


def test_its_programs_go_to_its_own_folder_whatever_the_run_uses():
    assert confined_environment(OWN, Path("/programs"))["JAX_COMPILATION_CACHE_DIR"] == "/programs"


def test_each_set_of_applications_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    assert programs_folder(["a" * 64, "b" * 64]) == programs_folder(["b" * 64, "a" * 64])
    assert programs_folder(["a" * 64]) != programs_folder(["b" * 64])


def test_where_ros_is_may_be_told_and_is_readable_then(monkeypatch: pytest.MonkeyPatch):
    given = confined_environment(OWN, Path("/programs"))
    assert (given["SIMYARD_ROS_PYTHON"], given["ROS_ROOT"]) == (OWN["SIMYARD_ROS_PYTHON"], OWN["ROS_ROOT"])
    monkeypatch.setenv("SIMYARD_ROS_PYTHON", OWN["SIMYARD_ROS_PYTHON"])
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
