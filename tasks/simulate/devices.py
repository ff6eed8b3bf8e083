"""How JAX sees this machine, and how long it compiles.

The settings are made before JAX is imported, because it reads them once. The seconds are those that JAX takes to trace,
lower and compile programs, or to load what was compiled, by thread. JAX tells of each such time at its end. A function
that is traced within another one is told of first, and again as part of the other, so that times are added up as
intervals. Nothing here imports JAX before it is asked for a time.
"""

import importlib.util
import os
import platform
import re
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

from specs.errors import SimyardError
from tasks.storage.base.local_files import cache_folder

_DEVICES_FLAG = "--xla_force_host_platform_device_count"
# Without fused multiply-add, which AVX2 brings: the compiler fuses in some places of a loop and not in others, so that
# the last bit of a lane's result would depend on where in the batch it lies, and on the processor. It costs a seventh.
_ISA_FLAG, _ISA = "--xla_cpu_max_isa", "AVX"
_X86 = ("x86_64", "AMD64")
_WITHOUT_FUSED = ("SSE4_2", "AVX")
_CACHE_SETTINGS = {
    # Every program is kept, however quickly it compiled: a rerun then compiles nothing.
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
# What brings JAX to a GPU, and what a machine with one has.
_GPU_PLUGINS = ("jax_cuda13_plugin", "jax_cuda12_plugin", "jax_rocm7_plugin", "jax_rocm60_plugin")
_GPU_FILES = {"CUDA_VISIBLE_DEVICES": Path("/dev/nvidiactl"), "ROCR_VISIBLE_DEVICES": Path("/dev/kfd")}
_NO_GPU = ("", "-1", "none", "NoDevFiles")  # values of these variables that hide all of them
DeviceKind = Literal["cpu", "gpu"]


class JaxAlreadyImported(SimyardError):  # noqa: N818 - a state
    """JAX was imported before its devices were set, so it would use one core and keep no programs."""


def device_count() -> int:
    """Returns how many host devices to split the lanes over: one for each core this process may use."""
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def device_kind() -> DeviceKind:
    """Returns what JAX is going to run on: a GPU if there is one and JAX has its plugin, unless JAX_PLATFORMS says."""
    asked = os.environ.get("JAX_PLATFORMS", "").split(",")[0].strip()
    if asked:
        return "cpu" if asked == "cpu" else "gpu"
    return "gpu" if gpu_here(os.environ) else "cpu"


def gpu_here(environment: Mapping[str, str]) -> bool:
    """Returns whether there is a GPU that these variables do not hide, and a plugin that brings JAX to it."""
    # It is asked for each row: to look for a file takes far less than to look for a module that is not there.
    found = any(path.exists() for name, path in _GPU_FILES.items() if environment.get(name) not in _NO_GPU)
    return found and any(importlib.util.find_spec(plugin) for plugin in _GPU_PLUGINS)


def rounds_each_operation() -> bool:
    """Returns whether programs round after each product and each sum, so that no bit hangs on how a loop is compiled.

    It is so on x86, unless the user lets programs fuse both; elsewhere nothing says so.
    """
    asked = re.findall(rf"{_ISA_FLAG}=(\S+)", os.environ.get("XLA_FLAGS", ""))
    allowed = asked[-1] if asked else _ISA
    return platform.machine() in _X86 and device_kind() == "cpu" and allowed in _WITHOUT_FUSED


def compilation_cache() -> Path:
    """Returns the folder of compiled programs."""
    return cache_folder() / "programs"


def prepare_devices() -> None:
    """Sets JAX's devices, instructions and compilation cache in this process's environment; may be called again.

    Settings that the user made win.

    Raises:
        JaxAlreadyImported: JAX was imported before the first call, and the settings would come too late.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    added = {_DEVICES_FLAG: str(device_count())} | ({_ISA_FLAG: _ISA} if platform.machine() in _X86 else {})
    wanted = dict(_CACHE_SETTINGS, JAX_COMPILATION_CACHE_DIR=str(compilation_cache()))
    missing = {name: value for name, value in wanted.items() if name not in os.environ}
    flags_added = [f"{flag}={value}" for flag, value in added.items() if flag not in flags]
    if flags_added:
        missing["XLA_FLAGS"] = " ".join([flags, *flags_added]).strip()
    if missing and "jax" in sys.modules:
        raise JaxAlreadyImported(
            f"jax was imported before {', '.join(sorted(missing))} could be set: "
            "call tasks.simulate.devices.prepare_devices() before anything imports jax"
        )
    os.environ.update(missing)


# JAX's own: `jax/core/compile/` has tracing, lowering, and the compiler or its cache (`jax/_src/dispatch.py`).
_COMPILING = "/jax/core/compile/"
# A program's times follow one another closely: what began longer ago holds none of those to come.
_INTERVALS_KEPT = 256


class CompileClock:
    """Adds up intervals that lie apart or within one another, told by their ends."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        """Begins at zero.

        Args:
            now_s: The time.
        """
        self._now_s = now_s
        self._apart: list[tuple[float, float]] = []
        self.seconds = 0.0

    def tell(self, event: str, duration_secs: float, **_: object) -> None:
        """Adds an interval that ends now, if it is one of compiling."""
        if not event.startswith(_COMPILING):
            return
        end_s = self._now_s()
        begin_s = end_s - duration_secs
        while self._apart and self._apart[-1][0] >= begin_s:
            inner_begin_s, inner_end_s = self._apart.pop()
            self.seconds -= inner_end_s - inner_begin_s
        if self._apart:  # clocks are read a little later than JAX reads them
            begin_s = max(begin_s, self._apart[-1][1])
        self._apart = [*self._apart[1 - _INTERVALS_KEPT :], (begin_s, end_s)]
        self.seconds += end_s - begin_s


class _OfThread(threading.local):
    clock: CompileClock | None = None


_of_thread, _listening, _turn = _OfThread(), threading.Event(), threading.Lock()


def compiled_s() -> float:
    """Returns the seconds that this thread has spent so since it asked first; JAX is imported then."""
    clock = _of_thread.clock
    if clock is None:
        clock = _of_thread.clock = CompileClock()
        _listen()
    return clock.seconds


def running_s() -> float:
    """Returns a clock's time that stands still while this thread compiles something; of each thread another."""
    return time.monotonic() - compiled_s()


def _listen() -> None:
    """Lets JAX tell this process of its times, once."""
    import jax.monitoring  # noqa: PLC0415 - the flow's process reads timings without JAX

    with _turn:
        if not _listening.is_set():
            jax.monitoring.register_event_duration_secs_listener(_tell_thread)
            _listening.set()


def _tell_thread(event: str, duration_secs: float, **more: str | int) -> None:
    """Tells the clock of the thread that compiled, which is the one that JAX calls."""
    if _of_thread.clock is not None:
        _of_thread.clock.tell(event, duration_secs, **more)
