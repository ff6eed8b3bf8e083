"""The machine and the versions that figures hold for, in a sentence."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

_PROCESSORS = Path("/proc/cpuinfo")
_NAME = "model name"
_PACKAGES = {"MuJoCo": "mujoco", "JAX": "jax"}


def machine() -> str:
    """Returns the processor, how many cores of it may be used, and the versions of what steps robots."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    versions = ", ".join(f"{name} {version(package)}" for name, package in _PACKAGES.items())
    return f"{_processor()}, {cores} cores; Python {platform.python_version()}, {versions}."


def _processor() -> str:
    lines = _PROCESSORS.read_text().splitlines() if _PROCESSORS.exists() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith(_NAME))
    return next(names, platform.processor() or platform.machine())
