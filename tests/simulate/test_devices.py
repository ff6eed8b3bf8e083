"""JAX's settings: made once, before it is imported, and never against the user's."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tasks.simulate.devices import (
    JaxAlreadyImported,
    compilation_cache,
    device_count,
    device_kind,
    prepare_devices,
    rounds_each_operation,
)

ASK = """
import sys
from tasks.simulate.devices import prepare_devices
prepare_devices()
assert "jax" not in sys.modules
import jax
print(len(jax.devices()), jax.config.jax_compilation_cache_dir)
"""


def test_jax_gets_a_device_for_each_core_and_a_cache_in_the_named_folder(tmp_path: Path):
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("JAX_") and k != "XLA_FLAGS"}
    done = subprocess.run(
        [sys.executable, "-c", ASK],
        env={**inherited, "SIMYARD_CACHE": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [str(device_count()), str(tmp_path / "programs")]


def test_the_users_own_settings_are_left_alone(monkeypatch: pytest.MonkeyPatch):
    own = "--xla_cpu_max_isa=AVX2 --xla_force_host_platform_device_count=1"
    monkeypatch.setenv("XLA_FLAGS", own)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/elsewhere")
    prepare_devices()
    assert os.environ["XLA_FLAGS"] == own
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "/elsewhere"


@pytest.mark.parametrize(("asked", "kind"), [("cpu", "cpu"), ("cuda,cpu", "gpu")])
def test_the_kind_of_device_is_the_one_that_the_user_names(monkeypatch: pytest.MonkeyPatch, asked: str, kind: str):
    monkeypatch.setenv("JAX_PLATFORMS", asked)
    assert device_kind() == kind


def test_without_a_plugin_there_is_no_gpu(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert device_kind() == "cpu"


@pytest.mark.parametrize(
    ("machine", "flags", "platforms", "rounds"),
    [
        ("x86_64", "", "cpu", True),
        ("AMD64", "--xla_cpu_max_isa=AVX --other=1", "cpu", True),
        ("x86_64", "--xla_cpu_max_isa=AVX2", "cpu", False),
        ("aarch64", "", "cpu", False),
        ("x86_64", "", "cuda", False),
    ],
)
def test_each_operation_is_rounded_on_x86_without_fused_ones(
    monkeypatch: pytest.MonkeyPatch, machine: str, flags: str, platforms: str, *, rounds: bool
):
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setenv("XLA_FLAGS", flags)
    monkeypatch.setenv("JAX_PLATFORMS", platforms)
    assert rounds_each_operation() is rounds


def test_settings_that_would_come_too_late_are_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "jax", sys)
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    with pytest.raises(JaxAlreadyImported, match="JAX_COMPILATION_CACHE_DIR"):
        prepare_devices()


def test_programs_are_kept_in_the_users_cache_folder(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/home/somebody/.cache")
    assert compilation_cache() == Path("/home/somebody/.cache/simyard/programs")
