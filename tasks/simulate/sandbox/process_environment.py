"""The variables that a process which simulates has: those of one table, and no other.

Variables of JAX, XLA, NumPy's libraries, MuJoCo and Python decide numbers, and numbers decide verdicts. So a user's own
are not passed on, but for those that say where a simulation runs and where its libraries are; and of these only values
that mean something, so that what is wrong with an environment is never taken for a fault of the robot.
"""

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from specs.base import Fault
from specs.errors import DocumentError
from tasks.simulate.devices import gpu_here
from tasks.storage.base.local_files import cache_folder


class PassedVariable(NamedTuple):
    """A variable that is the user's right.

    Attributes:
        name: Its name; one that ends with ``*`` stands for all that begin so.
        why: What it is passed on for.
        form: What its value is made of, as a regular expression; empty for anything.
        allowed: The same for a person.
    """

    name: str
    why: str
    form: str = ""
    allowed: str = ""


_ONE = r"([0-9]+(:[0-9]+)?|(GPU|MIG)-[0-9A-Za-z/-]+)"
_LIST = rf"(-1|none|NoDevFiles|{_ONE}(, *{_ONE})*)?"
_DEVICES = "numbers or ids of devices, such as 0,1; or -1 for none"
_XLA_FLAGS = r"\s*(--xla_(force_host_platform_device_count=[1-9][0-9]{0,2}|cpu_max_isa=(AVX|SSE4_2))\s*)*"
_OURS = "--xla_force_host_platform_device_count=N, up to 999, and --xla_cpu_max_isa=AVX or SSE4_2"

PASSED: tuple[PassedVariable, ...] = (
    PassedVariable("PATH", "finds programs that applications start"),
    PassedVariable("LD_LIBRARY_PATH", "finds libraries that are not where they usually are, such as CUDA's"),
    PassedVariable("VIRTUAL_ENV", "says where the environment of this Python is"),
    PassedVariable("LANG", "the machine's language"),
    PassedVariable("LANGUAGE", "the machine's language"),
    PassedVariable("LC_*", "the machine's language"),
    PassedVariable("TZ", "the machine's time zone"),
    PassedVariable("SIMYARD_IMPORT_LIMIT_S", "how long the import of an application may take"),
    PassedVariable("SIMYARD_STEP_LIMIT_S", "how long a call of an application may take"),
    PassedVariable("SIMYARD_PROGRAMS", "whether programs are traced anew"),
    PassedVariable("SIMYARD_ROS_PYTHON", "where ROS is, if not where it usually is"),
    PassedVariable("ROS_ROOT", "where ROS is, if not where it usually is"),
    PassedVariable("AMENT_PREFIX_PATH", "where ROS 2 is, if not where it usually is"),
    PassedVariable("ROS_DISTRO", "which release of ROS 2, if several are here"),
    PassedVariable("RMW_IMPLEMENTATION", "which middleware nodes of ROS 2 speak, if several are here"),
    PassedVariable(
        "JAX_PLATFORMS", "CPU or GPU", r"(cpu|(cuda|rocm|gpu)(,cpu)?)?", "cpu, or with a GPU: cuda, rocm or cuda,cpu"
    ),
    PassedVariable(
        "XLA_FLAGS",
        "how many devices the CPU is",
        _XLA_FLAGS,
        f"{_OURS}: other flags change what a simulation computes, or are gone, which ends it",
    ),
    PassedVariable("CUDA_VISIBLE_DEVICES", "which GPUs", _LIST, _DEVICES),
    PassedVariable("CUDA_DEVICE_ORDER", "how GPUs are numbered", r"FASTEST_FIRST|PCI_BUS_ID|", "PCI_BUS_ID"),
    PassedVariable("NVIDIA_VISIBLE_DEVICES", "which GPUs, in a container"),
    PassedVariable("NVIDIA_DRIVER_CAPABILITIES", "what of the driver, in a container"),
    PassedVariable("ROCR_VISIBLE_DEVICES", "which GPUs", _LIST, _DEVICES),
    PassedVariable("HIP_VISIBLE_DEVICES", "which GPUs", _LIST, _DEVICES),
    PassedVariable(
        "XLA_PYTHON_CLIENT_MEM_FRACTION", "of a GPU's memory", r"(0?\.[0-9]*[1-9][0-9]*|1(\.0*)?)?", "above 0, up to 1"
    ),
    PassedVariable(
        "XLA_PYTHON_CLIENT_PREALLOCATE",
        "whether all of it is taken at once",
        r"(?i:true|false|0|1|)",
        "true or false",
    ),
    PassedVariable(
        "XLA_PYTHON_CLIENT_ALLOCATOR",
        "how it is taken",
        r"(default|platform|bfc|cuda_async)?",
        "default, platform, bfc or cuda_async",
    ),
    PassedVariable(
        "OPENBLAS_CORETYPE",
        "which processor this is, where OpenBLAS mistakes it",
        r"[A-Za-z0-9_]*",
        "a processor that OpenBLAS knows, such as Haswell",
    ),
    PassedVariable(
        "OPENBLAS_L2_SIZE", "how large its cache is, where a virtual machine does not say", r"[0-9]*", "kilobytes"
    ),
    PassedVariable(
        "MUJOCO_GL",
        "what an application that renders draws with",
        r"(?i:disable|disabled|off|false|0|egl|osmesa|glfw|glx|)",
        "egl or osmesa, for an application that renders; else leave it out",
    ),
)
"""All that is passed on, with a reason each; an empty value is one that is not set."""

FIXED: Mapping[str, tuple[str, str]] = {
    "TF_CPP_MIN_LOG_LEVEL": ("3", "what XLA says of itself is not the application's output"),
    "MUJOCO_GL": ("disable", "MuJoCo would load GLFW, for a display that is not told to it; the user's wins"),
    "PYTHONDONTWRITEBYTECODE": ("1", "bundles stay as their digests say"),
    "PYTHONHASHSEED": ("0", "the order of a set in a controller is the same each time"),
    "PYTHONUTF8": ("1", "files are read the same in any language"),
    "PYTHONUNBUFFERED": ("1", "what a controller prints is there when its process ends"),
    "OPENBLAS_NUM_THREADS": ("1", "its threads wait for work by turning in circles, which costs a process a second"),
    "HOME": ("/tmp", "of the process alone, as TMPDIR; a folder of its own where bubblewrap is not"),  # noqa: S108
}
"""Values that are the same on each machine, with a reason each."""

# Set to nothing, these hide every device; any other variable is then as good as not set.
_HIDES = "_VISIBLE_DEVICES"
FAMILIES = ("JAX_", "XLA_", "TF_XLA_", "LIBTPU_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_", "NUMEXPR_", "NPY_", "MUJOCO_")
"""Beginnings of the names of which a user should hear that they are not passed on: they decide numbers elsewhere."""


def process_environment(own: Mapping[str, str], programs: Path) -> dict[str, str]:
    """Returns the variables of a process that simulates: of the table, with neither keys nor credentials nor addresses.

    Args:
        own: What the run's environment has.
        programs: Folder of its compiled programs.

    Raises:
        DocumentError: A variable that is passed on has a value that means nothing.
    """
    require_environment(own)
    return {
        **{name: value for name, (value, _) in FIXED.items()},
        **{name: value for name, value in own.items() if passed_variable(name) and (value or name.endswith(_HIDES))},
        # Also where the run's environment names another folder: no application writes what another one loads.
        "JAX_COMPILATION_CACHE_DIR": str(programs),
        "PYTHONPATH": module_path(),
        "SIMYARD_CACHE": str(cache_folder()),
    }


def module_path() -> str:
    """Returns where modules are looked for, by names that hold in any folder."""
    return os.pathsep.join(dict.fromkeys(str(Path(path).resolve()) for path in sys.path if path))


def require_environment(own: Mapping[str, str]) -> None:
    """Refuses variables that are passed on and whose values mean nothing, all at once.

    Args:
        own: What the run's environment has.

    Raises:
        DocumentError: There are some; each is named, with what is allowed.
    """
    faults = [
        _fault(name, " ".join(wrong), f"{found.allowed}; or unset it, as in: env -u {name} simyard ...")
        for name, value in sorted(own.items())
        if (found := passed_variable(name)) and (wrong := _wrong_words(value, found.form))
    ]
    platform = own.get("JAX_PLATFORMS", "").partition(",")[0]
    if platform in {"cuda", "rocm", "gpu"} and not gpu_here(own):
        why = "cpu: no GPU is here that JAX has its plugin for (docs/reference/engines.md); or unset it"
        faults.append(_fault("JAX_PLATFORMS", own["JAX_PLATFORMS"], why))
    if faults:
        raise DocumentError(faults)


def _wrong_words(value: str, form: str) -> list[str]:
    """Returns the words of a value that have not the form: some of several flags, or all of another value."""
    if not form or re.fullmatch(form, value):
        return []
    return [word for word in value.split() if not re.fullmatch(form, word)] or [value]


def _fault(name: str, value: str, allowed: str) -> Fault:
    return Fault(path=f"environment variable {name}", value=repr(value), allowed=allowed)


def left_out(own: Mapping[str, str]) -> list[str]:
    """Returns the names of variables that a user may have set for simulations, and that do not reach them.

    One that has the value of each simulation is none of them.
    """
    fixed = {name: value for name, (value, _) in FIXED.items()}
    return sorted(
        name
        for name, value in own.items()
        if name.startswith(FAMILIES) and not passed_variable(name) and fixed.get(name) != value
    )


def passed_variable(name: str) -> PassedVariable | None:
    """Returns what a variable is passed on for; None if it is not."""
    for each in PASSED:
        if each.name == name or (each.name.endswith("*") and name.startswith(each.name[:-1])):
            return each
    return None
