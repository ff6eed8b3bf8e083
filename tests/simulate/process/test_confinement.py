"""What the process that runs applications is given: settings of simulations, and a folder for its own programs."""

from pathlib import Path

import pytest

from tasks.simulate.process.confinement import confined_environment, programs_folder

OWN = {
    "PATH": "/usr/bin",
    "LC_ALL": "C",
    "XLA_FLAGS": "--one",
    "JAX_COMPILATION_CACHE_DIR": "/of/the/run",
    "SIMYARD_STEP_LIMIT_S": "3",
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


def test_its_programs_go_to_its_own_folder_whatever_the_run_uses():
    assert confined_environment(OWN, Path("/programs"))["JAX_COMPILATION_CACHE_DIR"] == "/programs"


def test_each_set_of_applications_has_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    assert programs_folder(["a" * 64, "b" * 64]) == programs_folder(["b" * 64, "a" * 64])
    assert programs_folder(["a" * 64]) != programs_folder(["b" * 64])
