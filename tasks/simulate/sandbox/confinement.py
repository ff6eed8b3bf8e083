"""How much the process that runs applications is shut in: where bubblewrap works, without network and on files to read.

In every case it is a process of its own, without the keys, credentials and addresses that the run's environment holds,
and it gets no handle on the store. In bubblewrap it sees the system's programs and libraries, Python's, what it
simulates, and a folder of its own for compiled programs; no other file, process or network is there for it.
"""

import functools
import hashlib
import os
import shutil
import site
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import specs
import tasks
from tasks.simulate.devices import device_kind
from tasks.storage.base.local_files import cache_folder

Level = Literal["bubblewrap", "process"]
CONFINEMENT = "SIMYARD_CONFINEMENT"
_PROBE_S = 20.0
# What a program needs of a system, and nothing that tells of its users.
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/opt", "/sys")
_ETC = (
    "alternatives ld.so.cache ld.so.conf ld.so.conf.d localtime timezone passwd group nsswitch.conf mime.types OpenCL "
    "ros"
)
_GPU_DEVICES = ("nvidia*", "kfd", "dri")
# Where ROS is, where that is not where it usually is: its Python, and the folder share/ros within its own.
_ROS_PYTHON, _ROS_ROOT = "SIMYARD_ROS_PYTHON", "ROS_ROOT"
# Of memory, what /tmp may take: nodes of ROS have their home folders there.
_TMP_SHARE = 0.25


class Confinement(NamedTuple):
    """How applications run.

    Attributes:
        level: What shuts them in.
        why: Why it is not more; empty where it is the most.
    """

    level: Level
    why: str = ""

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        if self.level == "bubblewrap":
            return "in a process of their own, without keys, network and files to write (bubblewrap)"
        return f"in a process of their own, without keys; with network and this account's files: {self.why}"


@functools.cache
def confinement() -> Confinement:
    """Returns how applications run here: in bubblewrap if that works, and if SIMYARD_CONFINEMENT is not ``process``."""
    if os.environ.get(CONFINEMENT, "") == "process":
        return Confinement("process", f"{CONFINEMENT} says so")
    program = shutil.which("bwrap")
    if program is None:
        return Confinement("process", "bubblewrap is not installed")
    command = [program, *_shut_in(), "--", sys.executable, "-I", "-c", ""]
    try:
        tried = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_S, check=False)  # noqa: S603 - of this module's making
    except (OSError, subprocess.TimeoutExpired) as exc:
        return Confinement("process", f"bubblewrap does not start: {exc}")
    if tried.returncode:
        return Confinement("process", f"bubblewrap does not work here: {tried.stderr.strip()[:200]}")
    return Confinement("bubblewrap")


def confined_command(arguments: Sequence[str], programs: Path, folders: Iterable[Path]) -> list[str]:
    """Returns the command of a Python process that is shut in as far as this machine can.

    Args:
        arguments: Of Python.
        programs: Folder that it may write to.
        folders: More folders that it may read.
    """
    if confinement().level == "process":
        return [sys.executable, *arguments]
    program = shutil.which("bwrap") or "bwrap"
    return [program, *_shut_in(programs, folders), "--", sys.executable, *arguments]


def programs_folder(digests: Iterable[str]) -> Path:
    """Returns the folder of the programs that these applications are compiled to.

    What an application writes there, no other one loads.
    """
    name = hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()[:32]
    folder = cache_folder() / "programs" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _shut_in(programs: Path | None = None, folders: Iterable[Path] = ()) -> list[str]:
    found = ["--unshare-all", "--die-with-parent", "--cap-drop", "ALL", *_tmp_size(), "--tmpfs", "/tmp"]  # noqa: S108 - a new one
    found += ["--dev", "/dev", "--proc", "/proc", "--chdir", "/tmp"]  # noqa: S108
    for path in (*_readable(), *folders):
        found += ["--ro-bind-try", str(path), str(path)]
    if device_kind() == "gpu":
        for path in (path for name in _GPU_DEVICES for path in sorted(Path("/dev").glob(name))):
            found += ["--dev-bind-try", str(path), str(path)]
    return [*found, "--bind", str(programs), str(programs)] if programs else found


@functools.cache
def _tmp_size() -> tuple[str, ...]:
    """Returns what bounds the /tmp that follows; nothing for a bubblewrap that is too old to."""
    program = shutil.which("bwrap") or "bwrap"
    told = subprocess.run([program, "--help"], capture_output=True, text=True, timeout=_PROBE_S, check=False)  # noqa: S603 - found on PATH
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return ("--size", str(int(_TMP_SHARE * memory))) if "--size" in told.stdout + told.stderr else ()


def _ros_folders() -> Iterator[Path]:
    """Yields where ROS lies if somebody has said so; never a folder that holds a person's home."""
    told = (Path(os.environ[name]).parent.parent for name in (_ROS_PYTHON, _ROS_ROOT) if os.environ.get(name))
    yield from (folder for folder in told if folder.is_absolute() and not Path.home().is_relative_to(folder))


def _readable() -> Iterator[Path]:
    """Yields what the process may read, folders before what lies in them."""
    home = cache_folder()
    yield from map(Path, _SYSTEM)
    yield from (Path("/etc") / name for name in _ETC.split())
    yield from _ros_folders()
    yield from dict.fromkeys(map(Path, (sys.base_prefix, sys.prefix, *_library_folders())))
    yield from (home / name for name in ("bundles", "data", "engines"))


def _library_folders() -> Iterator[str]:
    """Yields where modules are imported from; of Simyard itself, if it lies in a checkout, its packages alone.

    The folder of a script that somebody runs is none of these: keys may lie beside it.
    """
    checkout = Path(tasks.__path__[0]).parent.resolve()
    yield from (specs.__path__[0], tasks.__path__[0])
    chosen = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    for entry in filter(None, [*sys.path, *sysconfig.get_paths().values(), *site.getsitepackages()]):
        library = Path(entry).name in {"site-packages", "dist-packages"} or entry in chosen
        if library and Path(entry).exists() and Path(entry).resolve() not in {checkout, Path.cwd().resolve()}:
            yield entry
