"""How much the process that runs applications is shut in, and whether that is enough for what it runs.

In every case it is a process of its own, without the keys, credentials and addresses that the run's environment holds,
and it gets no handle on the store. In bubblewrap it sees the system's programs and libraries, Python's, what it
simulates, and a folder of its own for compiled programs; no other file, process or network is there for it. Where
bubblewrap is not installed, the process builds a wall around itself that lets it have the same files
(`self_confinement`). Where neither works, strangers' code would have this account's files: a process that holds keys,
or works for others, then runs only applications that come with Simyard, or that somebody says are her own.
"""

import hashlib
import os
import shutil
import site
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import specs
import tasks
from specs.base import Fault
from specs.errors import DocumentError, StageFailed
from specs.launched_file import IMAGE_FILE, PACKAGE_XML
from specs.settings import OWNER_KEY, TRUST_APPLICATIONS, WORKS_FOR_OTHERS, access_file
from tasks.simulate.devices import device_kind
from tasks.simulate.sandbox.process_environment import module_path
from tasks.simulate.sandbox.self_confinement import OWN_NETWORK, PROBE, self_confined
from tasks.storage.base.local_files import cache_folder
from tasks.storage.image_files import image_root
from tasks.storage.sealed_bundle import is_shipped

Level = Literal["bubblewrap", "landlock", "process"]
CONFINEMENT = "SIMYARD_CONFINEMENT"
_PROBE_S = 20.0
# What a program needs of a system, and nothing that tells of its users.
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/opt/ros", "/sys")
_ETC = (
    "alternatives ld.so.cache ld.so.conf ld.so.conf.d localtime timezone passwd group nsswitch.conf mime.types OpenCL "
    "ros"
)
# Of Nix and Guix: whatever a Python from there is linked with lies beside it, and everybody may read all of it.
_PACKAGE_STORES = (Path("/nix/store"), Path("/gnu/store"))
# Of the folder that a Python is in; the rest of it may be a home, or programs of others.
_OF_PYTHON = ("bin", "lib", "lib64", "pyvenv.cfg")
_GPU_DEVICES, _GPU_LIBRARIES = ("nvidia*", "kfd", "dri", "dxg"), "rocm*"  # dxg: of WSL 2
_OWN_DEVICES = ("null", "zero", "full", "random", "urandom")
# Where ROS is, where that is not where it usually is: its Python, and the folder share/ros within its own.
_ROS_PYTHON, _ROS_ROOT = "SIMYARD_ROS_PYTHON", "ROS_ROOT"
# Where packages of ROS 2 are installed, as its set-up files say it.
_ROS2_PREFIXES = "AMENT_PREFIX_PATH"
# Of memory, what /tmp may take: nodes of ROS have their home folders there.
_TMP_SHARE = 0.25
# The largest compiled program has some 100 MB.
_FILE_BYTES = 1 << 30
# Nodes of ROS have some ten threads each, and a lane some nodes.
_PROCESSES_A_CORE, _PROCESSES = 1024, 8192
# What libraries map and never touch, beside memory: JAX, XLA and C MuJoCo 1.8 GB on two cores, most of it by threads.
_MAPPED_BYTES, _MAPPED_A_CORE_BYTES = 16 << 30, 1 << 30
# Secrets that strangers' code could read out of this process, where nothing shuts it in.
_SECRETS = {
    "SIMYARD_KEYS": "the keys of fleets (SIMYARD_KEYS)",
    OWNER_KEY: "the key by which the owner vouches (SIMYARD_OWNER_KEY)",
    "AWS_SECRET_ACCESS_KEY": "AWS's credentials (AWS_SECRET_ACCESS_KEY)",
    "AWS_SESSION_TOKEN": "AWS's credentials (AWS_SESSION_TOKEN)",
    "AWS_WEB_IDENTITY_TOKEN_FILE": "AWS's credentials (AWS_WEB_IDENTITY_TOKEN_FILE)",
    WORKS_FOR_OTHERS: "jobs of a queue, which others may fill",
    "PREFECT__FLOW_RUN_ID": "flow runs for a Prefect server, which others may ask for",
}
_INSTALL = "apt-get install bubblewrap"
_OTHER = "1000"


class Confinement(NamedTuple):
    """How applications run.

    Attributes:
        level: What shuts them in.
        why: Why it is not more; empty where it is the most.
        broken: Whether what should shut them in is there and does not work.
        network: Whether nodes of ROS reach each other inside.
    """

    level: Level
    why: str = ""
    broken: bool = False
    network: bool = True

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        match self.level:
            case "bubblewrap":
                return "in a process of their own, without keys, network and files to write (bubblewrap)"
            case "landlock":
                return "in a process of their own, without keys, network and files to write (Landlock)"
            case "process":
                return f"in a process of their own, without keys; with network and this account's files: {self.why}"


# By what was asked for; what is broken is not among these.
_settled: dict[str, Confinement] = {}


def confinement() -> Confinement:
    """Returns how applications run here: in bubblewrap, else behind a wall of their own, or as it is asked.

    It is tried once; again where what is there did not work, which may be repaired, or was only slow.

    Raises:
        DocumentError: SIMYARD_CONFINEMENT says nothing that there is.
    """
    asked = os.environ.get(CONFINEMENT, "")
    if asked not in {"", *get_args(Level)}:
        raise DocumentError.of(CONFINEMENT, repr(asked), ", ".join(get_args(Level)))
    found = _settled.get(asked) or _found(asked)
    if not found.broken:
        _settled[asked] = found
    return found


def _found(asked: str) -> Confinement:
    if asked == "process":
        return Confinement("process", f"{CONFINEMENT} says so")
    if asked == "bubblewrap" or (not asked and shutil.which("bwrap")):
        why = _tried(_bubblewrap_command(PROBE, (), _NO_PLACE, ())).why
        return Confinement("process", f"bubblewrap does not work here: {why}", broken=True) if why else BUBBLEWRAP
    why, said, slow = _landlock_probe()
    if not why:
        return Confinement("landlock", network=said == OWN_NETWORK)
    if asked or slow:
        return Confinement("process", f"Landlock does not work here: {why}", broken=True)
    return Confinement("process", f"bubblewrap is not installed, and Landlock does not work here: {why}")


BUBBLEWRAP = Confinement("bubblewrap")


class _Trial(NamedTuple):
    """Why a command failed, empty if it did not; what it printed; and whether it was only too slow."""

    why: str
    said: str = ""
    slow: bool = False


def _tried(command: Sequence[str]) -> _Trial:
    environment = {"PATH": os.environ.get("PATH", ""), "PYTHONPATH": module_path()}
    try:
        tried = subprocess.run(  # noqa: S603 - of this module's making
            command, env=environment, capture_output=True, text=True, timeout=_PROBE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return _Trial(f"trying it took longer than {_PROBE_S:g} s", slow=True)
    except OSError as exc:
        return _Trial(str(exc))
    why = tried.stderr.strip().rpartition("\n")[2][:200] or f"it ends with {tried.returncode}"
    return _Trial(why if tried.returncode else "", tried.stdout)


def _landlock_probe() -> _Trial:
    return _tried(_landlock_command(PROBE, (), _NO_PLACE, ()))


def require_confined(bundles: Iterable[Path]) -> None:
    """Lets applications run: shut in, or where there is nothing to take, or those that somebody answers for.

    Args:
        bundles: Their folders.

    Raises:
        StageFailed: Strangers' code would reach what this process holds.
    """
    if why := next((why for bundle in bundles if (why := _refusal(bundle))), ""):
        raise StageFailed("InternalServiceError", f"applications do not run: {why}")


def confinement_faults(bundles: Iterable[tuple[str, Path]]) -> list[Fault]:
    """Returns a fault for each application of a document that `require_confined` would not let run.

    Args:
        bundles: Names and folders of applications; not looked at where all are shut in.
    """
    if confinement().level == "bubblewrap":
        return []
    found = ((name, _refusal(folder)) for name, folder in bundles)
    allowed = "an application that comes with Simyard, or one that is shut in:"
    return [Fault(path="simulationBatch", value=repr(name), allowed=f"{allowed} {why}") for name, why in found if why]


def _refusal(bundle: Path) -> str:
    """Returns why an application does not run in this process's name, and what to do; empty where it does."""
    found = confinement()
    if (bundle / IMAGE_FILE).is_file() and found.level != "bubblewrap":
        return f"container images run in bubblewrap alone: {_INSTALL}, and unset {CONFINEMENT}"
    if not found.network and any(bundle.rglob(PACKAGE_XML)):
        why = "nodes of ROS talk over a network, and Landlock gives them none of their own on this machine"
        return f"{why}: {_INSTALL}, or for your own nodes {CONFINEMENT}=process"
    if found.level != "process" or os.environ.get(TRUST_APPLICATIONS) or is_shipped(bundle):
        return ""
    own = f"if all applications are your own: simyard --trust-applications ..., or {TRUST_APPLICATIONS}=1"
    if found.broken:
        of_ros, (no_landlock, said, _) = any(bundle.rglob(PACKAGE_XML)), _landlock_probe()
        if not no_landlock and (said == OWN_NETWORK or not of_ros):
            other = f", or choose another confinement: {CONFINEMENT}=landlock"
        else:
            other = f", or for your own nodes {CONFINEMENT}=process" if of_ros else ""
        return f"{found.why}; repair it{other}; or, {own}"
    held = next(_held(), "")
    remedy = f"unset {CONFINEMENT}" if os.environ.get(CONFINEMENT) else _INSTALL
    return f"nothing shuts them in ({found.why}), and this process has {held}: {remedy}; or, {own}" if held else ""


def _held() -> Iterator[str]:
    """Yields what strangers' code could take where nothing shuts it in."""
    yield from (what for name, what in _SECRETS.items() if os.environ.get(name))
    if os.access(access_file(), os.R_OK):
        yield f"the keys of a gateway's clients ({access_file()})"


class Place(NamedTuple):
    """Where a confined process may write.

    Attributes:
        programs: Folder of its compiled programs.
        folder: Its own, in which it runs: home and temporary files, unless bubblewrap gives it a new /tmp.
    """

    programs: Path
    folder: Path

    def variables(self) -> dict[str, str]:
        """Returns what tells the process where its own files go."""
        own = "/tmp" if confinement().level == "bubblewrap" else str(self.folder)  # noqa: S108 - bubblewrap's is new
        return {"HOME": own, "TMPDIR": own}


_NO_PLACE = Place(Path("/nonexistent"), Path("/nonexistent"))


def confined_command(module: str, arguments: Sequence[str], place: Place, folders: Iterable[Path]) -> list[str]:
    """Returns the command of a module of Python's that is shut in as far as this machine can.

    Args:
        module: As for ``python -m``.
        arguments: Its own.
        place: Where it may write.
        folders: More folders that it may read.
    """
    match confinement().level:
        case "bubblewrap":
            return _bubblewrap_command(module, arguments, place, folders)
        case "landlock":
            return _landlock_command(module, arguments, place, folders)
        case "process":
            return [*_python(), *self_confined(module, arguments, limits=_limits())]


def _bubblewrap_command(module: str, arguments: Sequence[str], place: Place, folders: Iterable[Path]) -> list[str]:
    program = shutil.which("bwrap") or "bwrap"
    own = self_confined(module, arguments, limits=_limits())
    bundles = [*folders]
    images = [root for bundle in bundles if (root := image_root(bundle))]
    # bubblewrap lets an account other than root have another bubblewrap inside, in which images are run.
    other = ["--unshare-user", "--uid", _OTHER, "--gid", _OTHER] if images and not os.getuid() else []
    return [program, *other, *_shut_in(place.programs, [*bundles, *images]), "--", *_python(), *own]


def _landlock_command(module: str, arguments: Sequence[str], place: Place, folders: Iterable[Path]) -> list[str]:
    devices = [Path("/dev", name) for name in _OWN_DEVICES]
    return [
        *_python(),
        *self_confined(
            module,
            arguments,
            limits=_limits(),
            readable=[str(path) for path in (*_readable(), Path("/proc"), *folders)],
            writable=[str(path) for path in (*place, *devices, *_gpu_devices())],
            listable=[str(Path(package.__path__[0]).resolve().parent) for package in (specs, tasks)],
        ),
    ]


def _python() -> tuple[str, ...]:
    """Returns this Python, by a name that no ``..`` is in: a folder that the process does not see cannot be left."""
    own = Path(sys.executable)
    return (str(own.parent.resolve() / own.name), "-P")  # no module is looked for where the process runs


def _limits() -> dict[str, int]:
    """Returns what the process may take of this machine; on a GPU libraries map more memory than any limit is for."""
    memory, cores = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"), os.cpu_count() or 1
    found = {
        "RLIMIT_CORE": 0,
        "RLIMIT_FSIZE": _FILE_BYTES,
        "RLIMIT_NPROC": max(_PROCESSES, _PROCESSES_A_CORE * cores),
    }
    mapped = {} if device_kind() == "gpu" else {"RLIMIT_AS": memory + _MAPPED_BYTES + _MAPPED_A_CORE_BYTES * cores}
    return {**found, **mapped}


def programs_folder(digests: Iterable[str]) -> Path:
    """Returns the folder of the programs that these applications are compiled to.

    What an application writes there, no other one loads.
    """
    name = hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()[:32]
    folder = cache_folder() / "programs" / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _shut_in(programs: Path, folders: Iterable[Path]) -> list[str]:
    found = ["--unshare-all", "--die-with-parent", "--cap-drop", "ALL", *_tmp_size(), "--tmpfs", "/tmp"]  # noqa: S108 - a new one
    found += ["--dev", "/dev", "--proc", "/proc", "--chdir", "/tmp"]  # noqa: S108
    for path in (*_readable(), *folders):
        found += ["--ro-bind-try", str(path), str(path)]
    for path in _gpu_devices():
        found += ["--dev-bind-try", str(path), str(path)]
    found += ["--bind-try", str(programs), str(programs)]
    return [*found, "--remount-ro", "/"]  # in which bubblewrap has made the folders on the way to these


def _gpu_devices() -> list[Path]:
    if device_kind() != "gpu":
        return []
    return [path for name in _GPU_DEVICES for path in sorted(Path("/dev").glob(name))]


def _tmp_size() -> tuple[str, ...]:
    """Returns what bounds the /tmp that follows; nothing for a bubblewrap that is too old to."""
    told = _tried([shutil.which("bwrap") or "bwrap", "--help"])
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return ("--size", str(int(_TMP_SHARE * memory))) if "--size" in told.said else ()


def _ros_folders() -> Iterator[Path]:
    """Yields where ROS lies if somebody has said so; never a folder that holds a person's home."""
    told = [Path(os.environ[name]).parent.parent for name in (_ROS_PYTHON, _ROS_ROOT) if os.environ.get(name)]
    for prefix in map(Path, filter(None, os.environ.get(_ROS2_PREFIXES, "").split(":"))):
        told.append(prefix)
        if (prefix / "pyvenv.cfg").is_file():  # a virtual environment: its Python is another one's
            told += [(prefix / "bin/python3").resolve().parents[1] / name for name in _OF_PYTHON]
    yield from (folder for folder in told if folder.is_absolute() and not Path.home().is_relative_to(folder))


def _readable() -> Iterator[Path]:
    """Yields what the process may read, folders before what lies in them."""
    yield from map(Path, _SYSTEM)
    yield from sorted(Path("/opt").glob(_GPU_LIBRARIES)) if device_kind() == "gpu" else ()
    yield from (Path("/etc") / name for name in _ETC.split())
    yield from _ros_folders()
    pythons = [place for prefix in (sys.base_prefix, sys.prefix) for place in (Path(prefix), Path(prefix).resolve())]
    yield from (store for store in _PACKAGE_STORES if any(python.is_relative_to(store) for python in pythons))
    found = (place / name for place in pythons for name in _OF_PYTHON)
    yield from dict.fromkeys((*found, *_library_folders()))
    yield from (cache_folder() / name for name in ("data", "engines"))


def _library_folders() -> Iterator[Path]:
    """Yields where modules are imported from; of Simyard itself, if it lies in a checkout, its packages alone.

    The folder of a script that somebody runs is none of these: keys may lie beside it.
    """
    checkout = Path(tasks.__path__[0]).parent.resolve()
    yield from (Path(package.__path__[0]).resolve() for package in (specs, tasks))
    chosen = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    for entry in filter(None, [*sys.path, *sysconfig.get_paths().values(), *site.getsitepackages()]):
        library, folder = Path(entry).name in {"site-packages", "dist-packages"} or entry in chosen, Path(entry)
        if library and folder.exists() and folder.resolve() not in {checkout, Path.cwd().resolve()}:
            yield folder.resolve()
