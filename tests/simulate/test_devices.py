"""JAX's settings: made once, before it is imported, and never against the user's."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.devices import (
    CompileClock,
    JaxAlreadyImported,
    compilation_cache,
    compiled_s,
    device_count,
    device_kind,
    prepare_devices,
    rounds_each_operation,
    running_s,
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


TRACE = "/jax/core/compile/jaxpr_trace_duration"


class Told:
    """A clock of compiling, told of intervals at their ends."""

    def __init__(self) -> None:
        self.at_s = 0.0
        self.clock = CompileClock(lambda: self.at_s)

    def interval(self, begin_s: float, end_s: float, event: str = TRACE) -> None:
        self.at_s = end_s
        self.clock.tell(event, end_s - begin_s)


def test_what_is_within_another_interval_is_counted_once():
    told = Told()
    for begin_s, end_s in ((1.0, 2.0), (4.0, 5.0), (3.5, 6.0), (0.5, 7.0), (8.0, 9.0)):
        told.interval(begin_s, end_s)
    assert told.clock.seconds == 7.5


def test_other_times_of_jax_are_not_counted():
    told = Told()
    told.interval(0.0, 5.0, "/jax/checkpoint/write_duration")
    assert told.clock.seconds == 0.0


def test_clocks_that_are_read_late_count_nothing_twice():
    told = Told()
    told.interval(1.0, 3.0)
    told.interval(2.9, 4.0)
    assert told.clock.seconds == pytest.approx(3.0)


@given(st.lists(st.integers(1, 50), min_size=1, max_size=600))
def test_intervals_that_lie_apart_are_added_up(durations: list[int]):
    told, at_s = Told(), 0.0
    for duration in durations:
        told.interval(at_s, at_s + duration)
        at_s += duration + 1
    assert told.clock.seconds == sum(durations)


def test_a_function_that_is_compiled_passes_no_running_time_and_one_that_is_there_compiles_nothing():
    function = jax.jit(lambda x: jnp.sin(x) + jnp.cos(x[::-1]) * 3.25)
    before_s = compiled_s()
    function(jnp.arange(17.0)).block_until_ready()
    compiled = compiled_s() - before_s
    assert compiled > 0.0
    before_s, ran_s = compiled_s(), running_s()
    function(jnp.arange(17.0)).block_until_ready()
    assert compiled_s() == before_s
    assert running_s() > ran_s
