"""Caches the functions of programs for processes to come: what one process has traced, the next one loads.

A program follows from the applications' files and settings, Simyard's own source, libraries, and devices; from modules
on PYTHONPATH, too, that a person works on, which no version tells of. A file is a head line in JSON, then a program's
bytes in StableHLO, which JAX reads and compiles: nothing in it is ever unpickled, and what is not whole is as good as
not there.
"""

import functools
import hashlib
import json
import logging
import os
import platform
import sys
import sysconfig
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
from jax import export
from jax.sharding import NamedSharding
from pydantic import ValidationError

import specs
import tasks.simulate
from specs.base import Spec
from specs.data.episode import ApplicationLaunch
from specs.field_types import EngineName
from tasks.simulate.engines.pytree_schema import UnknownPytree, pytree_of, schema_of
from tasks.simulate.lane.chunk_applications import Applications
from tasks.storage.base.local_files import HIDDEN, cache_folder, whole_file
from tasks.storage.sealed_bundle import FILES_FOLDER

logger = logging.getLogger(__name__)
# Raised when what is cached changes its form.
_FORMAT = 2
_SETTINGS = ("JAX_", "XLA_", "TF_", "LIBTPU_", "MUJOCO_")
# Where programs lie changes none of them.
_NO_MATTER = ("jax_compilation_cache_dir", "JAX_COMPILATION_CACHE_DIR")
# Of each kind in a folder, which holds what one set of applications was compiled to; a program takes a tenth of a
# megabyte or two, a passed check a few hundred bytes.
_FILES_AT_MOST = 400
# A program that holds so much, such as the weights of a network, is as quick to trace as to read.
_BYTES_AT_MOST = 64 << 20
_PROGRAM, _CHECK = ".program", ".check"
# Digests of bundles tell of their modules, versions of what is installed, and ``machine_identity`` of what simulates.
_BUNDLE = "simyard_bundle_"
_INSTALLED = ("site-packages", "dist-packages")
_PACKAGES = ("specs", "tasks", "flows", "simyard")
Function = Callable[..., Any]
OnCompile = Callable[[], None]
_folders: list[Path] = []
_listeners: list[OnCompile] = []


# An application is a function of its bundle, of its environment and of its data sources, so that these are enough.
# What else it reads of this machine while it is traced is not looked for, but for modules.
def applications_identity(
    launches: Iterable[ApplicationLaunch], folders: Iterable[Path], names: Sequence[str], texts: Mapping[str, str]
) -> str:
    """Returns what two applications' part of a program follows from; empty where that cannot be told.

    Args:
        launches: The applications.
        folders: Where their bundles are unpacked.
        names: Of the numeric environment variables.
        texts: The other ones. One that names a file which is no data source could hold anything.
    """
    if any(map(_names_a_file, texts.values())):
        return ""
    bundles = [
        (launch.digest, launch.package, launch.launch_file, _content(folder))
        for launch, folder in zip(launches, folders, strict=True)
    ]
    return json.dumps([bundles, list(names), sorted(texts.items())])


@functools.cache
def machine_identity() -> str:
    """Returns what every program of this process follows from, as one digest."""
    settings = {name: value for name, value in os.environ.items() if name.startswith(_SETTINGS)}
    settings |= {name: repr(value) for name, value in jax.config.values.items()}
    for name in _NO_MATTER:
        settings.pop(name, None)
    devices = [(each.platform, each.device_kind, each.client.platform_version) for each in jax.devices()]
    parts = [sys.version, platform.machine(), _libraries(), _source_digest(), sorted(settings.items()), devices]
    return _digest(json.dumps(parts))


def _source_digest() -> str:
    """Returns a digest of what simulates: a change of any module of it may change a program."""
    roots = (Path(specs.__path__[0]), Path(tasks.simulate.__path__[0]))
    return _folder_digest(path for root in roots for path in root.rglob("*.py"))


def _libraries() -> list[str]:
    """Returns all that is installed, each with its version, as the names of their metadata say."""
    folders = [Path(folder) for folder in sys.path if Path(folder).is_dir()]
    return sorted({path.name for folder in folders for path in folder.glob("*.dist-info")})


def _content(folder: Path) -> str:
    """Returns a digest of a bundle's files; empty of one that is sealed: it holds what its own digest says."""
    if folder.name == FILES_FOLDER:
        return ""
    return _folder_digest(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc")


def _folder_digest(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(paths):
        body = path.read_bytes()
        digest.update(f"{path} {len(body)}\n".encode() + body)
    return digest.hexdigest()


def _names_a_file(text: str) -> bool:
    """Returns whether a text is the path of something that another text may stand for tomorrow.

    A mounted data source lies in a folder that its digest names.
    """
    if "/" not in text or "\0" in text:
        return False
    path = Path(text)
    try:
        return path.exists() and not path.is_relative_to(cache_folder() / "data" / "mounts")
    except OSError:  # too long to be one
        return False


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


# Nothing in a file is ever unpickled: the head is JSON, and the program is StableHLO, which JAX reads and compiles.
class Dependency(Spec):
    """A file that a program follows from, and no key tells of.

    Attributes:
        path: Where it is.
        sha256: Of what it held.
    """

    path: str
    sha256: str


class Head(Spec):
    """What is known of a program.

    Attributes:
        schema_text: What its arrays are put together to (``pytree_schema``).
        whole: False for a program that cannot be cached, so that nobody tries again.
        dependencies: Files that must be what they were.
        sha256: Of the program's bytes.
    """

    schema_text: str = ""
    whole: bool = True
    dependencies: tuple[Dependency, ...] = ()
    sha256: str = ""


class CachedProgram(NamedTuple):
    """A program and what is known of it."""

    head: Head
    program: bytes


def read_cached(path: Path) -> CachedProgram | None:
    """Returns what was cached in a file; None where there is nothing, or what is there is not whole or out of date."""
    try:
        line, _, program = path.read_bytes().partition(b"\n")
        head = Head.model_validate_json(line)
    except (OSError, ValidationError):
        return None
    if head.sha256 != hashlib.sha256(program).hexdigest() or not all(map(_unchanged, head.dependencies)):
        return None
    with suppress(OSError):
        os.utime(path)  # the oldest goes first
    return CachedProgram(head, program)


def write_cached(path: Path, cached: CachedProgram) -> None:
    """Writes a program into a file, whole or not at all; a folder that cannot be written to caches nothing."""
    if len(cached.program) > _BYTES_AT_MOST:
        return
    head = cached.head.model_copy(update={"sha256": hashlib.sha256(cached.program).hexdigest()})
    try:
        with whole_file(path) as file:
            file.write(json.dumps(head.model_dump(mode="json")).encode() + b"\n" + cached.program)
        _thin_out(path.parent, path.suffix)
    except OSError as exc:
        logger.debug("a program is not cached: %s", exc)


def file_digest(path: Path) -> str:
    """Returns the SHA-256 of a file; empty of one that cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _unchanged(dependency: Dependency) -> bool:
    return file_digest(Path(dependency.path)) == dependency.sha256


def _thin_out(folder: Path, suffix: str) -> None:
    """Removes the files of a kind that were used longest ago, and what a process left that was killed as it wrote."""
    there = [path for path in folder.iterdir() if path.suffix == suffix or path.name.startswith(HIDDEN)]
    if len(there) <= _FILES_AT_MOST:
        return
    used_s: dict[Path, float] = {}
    for path in there:
        with suppress(OSError):  # another process was faster
            used_s[path] = path.stat().st_mtime
    for path in sorted(used_s, key=lambda each: used_s[each])[: len(there) - _FILES_AT_MOST]:
        path.unlink(missing_ok=True)


# An application may import one that a person works on, from a folder on PYTHONPATH: a program that was traced with it
# is out of date when it changes, and no version says so.
def module_dependencies() -> tuple[Dependency, ...]:
    """Returns the files of all modules that come neither from a bundle nor from a library nor from Simyard.

    A person may work on one, in a folder on PYTHONPATH, and no version tells of a change.
    """
    return tuple(Dependency(path=str(path), sha256=file_digest(path)) for path in sorted(set(_elsewhere())))


def _elsewhere() -> Iterator[Path]:
    known = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")]
    known += [Path(specs.__path__[0]).parent / name for name in _PACKAGES]
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if not isinstance(file, str) or name.startswith(_BUNDLE):
            continue
        path = Path(file)
        if not any(path.is_relative_to(folder) for folder in known) and not set(_INSTALLED) & set(path.parts):
            yield path


# A function is kept as StableHLO (``jax.export``): the machine code that XLA makes of it lies in JAX's own cache,
# whose key follows from those bytes, so that a process that loads both neither traces, lowers nor compiles
# (docs/decisions/0041-programs-without-tracing.md). The process that traces runs what it kept, so that all run the
# same.
def use_cache_folder(folder: Path, on_compile: OnCompile = lambda: None) -> None:
    """Caches programs in a folder from now on.

    Args:
        folder: No other applications than this process's may write to it.
        on_compile: Called before a function is traced and compiled that is not cached there.
    """
    _folders[:], _listeners[:] = [folder], [on_compile]


def open_program_cache(
    sharding: NamedSharding, applications: Applications, engine: EngineName, *, host: bool
) -> "ProgramCache":
    """Returns the cache of a program's functions.

    Args:
        sharding: How their arrays are split over the devices.
        applications: The robot application and the scenario.
        engine: That drives them.
        host: Whether the robot application runs on the host.
    """
    known = applications.identity
    return ProgramCache(sharding, json.dumps([known, engine, host, repr(applications.sensors)]) if known else "")


@dataclass(frozen=True)
class ProgramCache:
    """Caches the functions of one program.

    Attributes:
        sharding: How all their arrays, lanes first, are split over the devices.
        identity: What they follow from besides the shapes of their arrays; empty for a program that is not cached.
    """

    sharding: NamedSharding
    identity: str

    def cached(self, name: str, function: Function) -> Function:
        """Returns a function to be compiled, which is traced only if no process has cached it before.

        Args:
            name: Of the function, within the program.
            function: Takes and returns trees of arrays, with no type of an application's own (``flatten_state``); at
                least one that it takes lies on the devices.
        """
        if not self.enabled:
            return function

        def called(*given: Any) -> Any:  # noqa: ANN401 - as the function has them
            return self._called(name, function, given)

        called.__name__ = called.__qualname__ = name
        return called

    @property
    def enabled(self) -> bool:
        """Returns whether anything is cached."""
        return bool(self.identity and _folders)

    def passed(self, check: str, arguments: object, values: object = None) -> bool:
        """Returns whether a check was passed before, by this process or another.

        Args:
            check: Its name.
            arguments: Arrays of which it sees the shapes.
            values: What else it sees.
        """
        return self.enabled and read_cached(self._file(f"{check} {values!r}", arguments, _CHECK)) is not None

    def note_passed(self, check: str, arguments: object, values: object = None) -> None:
        """Notes that a check was passed; the arguments are those of ``passed``."""
        if self.enabled:
            nothing = CachedProgram(Head(dependencies=module_dependencies()), b"")
            write_cached(self._file(f"{check} {values!r}", arguments, _CHECK), nothing)

    def _called(self, name: str, function: Function, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401 - as it has them
        """Returns what a function returns of traced arguments, out of what is cached of it."""
        path = self._file(name, arguments, _PROGRAM)
        cached = read_cached(path)
        if cached is not None and cached.head.whole:
            try:
                return _result(cached, arguments)
            except Exception as exc:  # noqa: BLE001 - whatever lies in the file: it is made anew
                logger.debug("what is cached of %s cannot be loaded: %s", name, exc)
                cached = None
        if cached is None:
            for on_compile in _listeners:
                on_compile()
            cached = self._traced(function, arguments)
            write_cached(path, cached)
        return _result(cached, arguments) if cached.head.whole else function(*arguments)

    def _traced(self, function: Function, arguments: tuple[Any, ...]) -> CachedProgram:
        """Returns a function as it can be cached; what it raises while it is traced is raised here."""
        leaves, structure = jax.tree.flatten(arguments)
        made: list[Any] = []

        def flat(*arrays: jax.Array) -> list[jax.Array]:
            results, made_structure = jax.tree.flatten(function(*jax.tree.unflatten(structure, arrays)))
            made[:] = [made_structure]
            return results

        shapes = [_shape(leaf, self.sharding) for leaf in leaves]
        compiled = jax.jit(flat)
        compiled.trace(*shapes)  # an application's exceptions come from here, and no others
        try:
            schema, program = schema_of(made[0]), bytes(export.export(compiled)(*shapes).serialize())
        except (NotImplementedError, ValueError, UnknownPytree) as exc:  # such as one that calls the host back
            logger.debug("a program cannot be cached: %s", exc)
            return CachedProgram(Head(whole=False, dependencies=module_dependencies()), b"")
        return CachedProgram(Head(schema_text=schema, dependencies=module_dependencies()), program)

    def _file(self, name: str, arguments: object, suffix: str) -> Path:
        leaves, structure = jax.tree.flatten(arguments)
        shapes = [(leaf.shape, str(leaf.dtype), _is_weak(leaf)) for leaf in leaves]
        key = [_FORMAT, machine_identity(), self.identity, name, str(self.sharding), str(structure), shapes]
        return _folders[0] / f"{_digest(json.dumps(key))}{suffix}"


def _result(cached: CachedProgram, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401 - what the cached function returns
    results: Any = export.deserialize(bytearray(cached.program)).call(*jax.tree.leaves(arguments))
    return pytree_of(cached.head.schema_text, results)


def _shape(leaf: jax.Array, sharding: NamedSharding) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=sharding, weak_type=_is_weak(leaf))


def _is_weak(leaf: object) -> bool:
    return bool(getattr(leaf, "weak_type", False))
