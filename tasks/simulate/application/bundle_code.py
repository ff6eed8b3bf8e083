"""Imports the code of applications from their unpacked bundles, each in a namespace of its own, and times every call.

Another process sees which call is under way and since when, and may end this one.
"""

import importlib
import inspect
import io
import linecache
import re
import struct
import sys
import time
import tokenize
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib.machinery import (
    EXTENSION_SUFFIXES,
    SOURCE_SUFFIXES,
    ExtensionFileLoader,
    FileFinder,
    ModuleSpec,
    SourceFileLoader,
)
from mmap import mmap
from pathlib import Path
from types import CodeType, ModuleType
from typing import Literal, NamedTuple, ParamSpec, TypeVar

from specs.data.episode import ApplicationLaunch, Failure
from specs.errors import SimyardError

CLOCK_BYTES = 4096
CallKind = Literal["import", "call", "slice", "compile", "nodes"]
_KINDS: tuple[CallKind, ...] = ("import", "call", "slice", "compile", "nodes")
_CODES = ("", "RobotApplicationCrash", "SimulationApplicationCrash")
# A number that is odd while the rest is written, the beginning in seconds, kind, code, and how long the text is.
_HEAD = struct.Struct("<QdBBH")
_TEXT_BYTES = 400


# Who simulates may hang in an application's code and answer nothing any more. So each call is noted in a page of
# memory that the process which started it shares: that process sees how long a call takes, and whom to blame when it
# ends it.
class RunningCall(NamedTuple):
    """A call that is under way.

    Attributes:
        kind: What it is limited as.
        code: RoboMaker's failure code if it is to blame; empty where nobody is.
        what: Such as ``courier: importing nav/nav.py``.
        seconds: Since it began.
    """

    kind: CallKind
    code: str
    what: str
    seconds: float


class CallWatchdog:
    """Notes calls in shared memory; calls within a call are noted instead of it, and it again after them."""

    def __init__(self, memory: mmap | None = None) -> None:
        """Begins with no call.

        Args:
            memory: At least ``CLOCK_BYTES``; None notes nothing.
        """
        self._memory = memory
        self._number = 0
        self._stack: list[tuple[float, int, int, bytes]] = []

    @contextmanager
    def call(self, kind: CallKind, code: str, what: str) -> Generator[None, None, None]:
        """Notes a call for as long as the ``with`` block takes.

        While nodes of ROS work, the clock of the call that waits for them stands still: they have limits of their own.
        """
        if self._memory is None:
            yield
            return
        text = what.encode("utf-8", "replace")[:_TEXT_BYTES]
        began_s = time.monotonic()
        self._stack.append((began_s, _KINDS.index(kind), _CODES.index(code), text))
        self._write(self._memory)
        try:
            yield
        finally:
            self._stack.pop()
            if kind == "nodes":
                waited_s = time.monotonic() - began_s
                self._stack = [(since_s + waited_s, outer, by, said) for since_s, outer, by, said in self._stack]
            self._write(self._memory)

    def _write(self, memory: mmap) -> None:
        self._number += 2
        began_s, kind, code, text = self._stack[-1] if self._stack else (0.0, 0, 0, b"")
        _HEAD.pack_into(memory, 0, self._number + 1, began_s, kind, code, len(text))
        memory[_HEAD.size : _HEAD.size + len(text)] = text
        _HEAD.pack_into(memory, 0, self._number, began_s, kind, code, len(text))


def running_call(memory: mmap) -> RunningCall | None:
    """Returns the call that is under way in the process that notes them; None between calls, or while one is noted.

    The memory is written by a process that nobody trusts, so that whatever it holds is taken for what it can be.
    """
    number, began_s, kind, code, length = _HEAD.unpack_from(memory, 0)
    text = bytes(memory[_HEAD.size : _HEAD.size + min(length, _TEXT_BYTES)])
    if number % 2 or (number, began_s) != _HEAD.unpack_from(memory, 0)[:2] or not began_s > 0.0:
        return None
    seconds = max(0.0, time.monotonic() - began_s)
    return RunningCall(_KINDS[kind % len(_KINDS)], _CODES[code % len(_CODES)], text.decode("utf-8", "replace"), seconds)


class _Current:
    clock = CallWatchdog()


def use_watchdog(clock: CallWatchdog) -> None:
    """Notes all calls of this process with a clock from now on."""
    _Current.clock = clock


def timed_call(kind: CallKind, code: str, what: str) -> AbstractContextManager[None]:
    """Returns a ``with`` block that is noted by this process's clock; nothing is noted where no clock is used."""
    return _Current.clock.call(kind, code, what)


CrashCode = Literal["RobotApplicationCrash", "SimulationApplicationCrash"]
_REASON_LENGTH = 1000
_SOURCE_LENGTH = 160
_NAMESPACE = re.compile(r"simyard_bundle_[0-9a-f]{64}\.")
P = ParamSpec("P")
R = TypeVar("R")


# A bundle is imported below a package named after its digest, so two versions of an application live side by side in
# one process and neither can shadow a library. Modules of a bundle import each other relatively.
#
# What runs is what the sources say: bytecode (``__pycache__``, ``.pyc``) in a bundle is never read, since it may be
# of other sources, and none is written.
class BundleCrash(SimyardError):  # noqa: N818 - RoboMaker's name
    """An application's own code failed.

    Attributes:
        code: RoboMaker's failure code.
        reason: The exception and its place in the bundle, for a person, as one line.
    """

    def __init__(self, code: CrashCode, reason: str, place: str = "") -> None:
        """Makes it.

        Args:
            code: RoboMaker's failure code.
            reason: What went wrong; cut where it is too long.
            place: Where, as `` (file, line n: source)``; it is never cut.
        """
        self.code: CrashCode = code
        # One line, as RoboMaker's reasons are, and with the author's module names instead of the bundle's namespace.
        what, where = (" ".join(_NAMESPACE.sub("", text).split()) for text in (reason, place))
        where = f" {where}" if where else ""
        self.reason = what[: _REASON_LENGTH - len(where)] + where
        super().__init__(f"{code}: {self.reason}")

    @property
    def failure(self) -> Failure:
        """Returns both together."""
        return Failure(self.code, self.reason)


def load_factory(
    folder: Path, launch: ApplicationLaunch, factory: Literal["controller", "controllers", "scenario"], code: CrashCode
) -> Callable[..., object]:
    """Returns the function of that name in a bundle's ``<package>/<launch file>.py``.

    Args:
        folder: Where the bundle is unpacked.
        launch: The package and the launch file.
        factory: Name of the function.
        code: Whose failure it is.

    Raises:
        BundleCrash: The module does not import, or has no such function.
    """
    doing = f"{launch.name}: importing {launch.package}/{launch.module}.py"
    module = _called("import", code, doing, lambda: _import(folder, launch))
    found = getattr(module, factory, None)
    if not callable(found):
        raise BundleCrash(
            code, f"{launch.name}: {launch.package}/{launch.module}.py defines no function {factory}(environment)"
        )
    return found


def call_bundle(code: CrashCode, doing: str, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Returns what an application's function returns.

    Raises:
        BundleCrash: The function raised, whatever it was: an application that calls ``sys.exit`` has crashed.
    """
    return _called("call", code, doing, lambda: function(*args, **kwargs))


def crash_of(exc: BaseException, launches: Mapping[CrashCode, ApplicationLaunch]) -> BundleCrash | None:
    """Returns the crash of the application whose code an exception passed through; None if it passed through none.

    Args:
        exc: What was raised, also out of a compiled program that calls the application back.
        launches: The applications, by what a crash of theirs is called.
    """
    frame = _bundle_frame(exc)
    for code, launch in launches.items():
        if launch.digest in (frame.module if frame else _words(exc)):
            return _crash(code, launch.name, exc)
    return None


def crash_code(text: str) -> CrashCode:
    """Returns a failure code as that of a crash; what is none is the robot application's."""
    return "SimulationApplicationCrash" if text == "SimulationApplicationCrash" else "RobotApplicationCrash"


def function_place(function: object) -> str:
    """Returns ``nav/nav.py, line 12`` of a function of an application; empty for what has no place in a file."""
    try:
        whole = inspect.unwrap(function)  # pyright: ignore[reportArgumentType] - whatever it is, it is tried
        line = inspect.getsourcelines(whole)[1]  # pyright: ignore[reportArgumentType]
        name = getattr(whole, "__module__", "")
    except (OSError, TypeError, ValueError):
        return ""
    return f"{_module_file(name)}, line {line}" if _NAMESPACE.match(name) else ""


def _called(kind: CallKind, code: CrashCode, doing: str, function: Callable[[], R]) -> R:
    try:
        with timed_call(kind, code, doing):
            return function()
    except BundleCrash:
        raise
    except BaseException as exc:  # an application may raise anything, and it is a row, not our failure
        raise _crash(code, doing, exc) from exc


class _Frame(NamedTuple):
    """A line of a bundle that an exception passed through."""

    module: str
    line: int
    source: str

    def __str__(self) -> str:
        """Returns ``nav/nav.py, line 12: x = way["goal"]``."""
        source = self.source if len(self.source) <= _SOURCE_LENGTH else f"{self.source[:_SOURCE_LENGTH]}..."
        return f"{_module_file(self.module)}, line {self.line}" + (f": {source}" if source else "")


def _crash(code: CrashCode, doing: str, exc: BaseException) -> BundleCrash:
    frame = _bundle_frame(exc)
    place = [f"({frame})"] if frame else []
    remedies = [remedy for form, remedy in _REMEDIES if code == "RobotApplicationCrash" and form.search(_words(exc))]
    colon = ":" if remedies and not place else ""
    return BundleCrash(code, f"{doing}: {_text(exc)}{colon}", ": ".join([*place, *remedies]))


# What an author forgot, where the words of an exception do not say it.
_PLAIN = "is plain Python: write jax = False into its module"
_REMEDIES = (
    (re.compile(r"Tracer\w+Error|ConcretizationTypeError"), f"a controller that asks for a number's value {_PLAIN}"),
    (re.compile(r"has no attribute 'init'"), f"a controller that has reset, and no init, {_PLAIN}"),
    (
        re.compile(r"zero-size array|empty sequence|axis \d+ with size 0"),
        "ranges_m is empty where a controller declares no lidar, as in lidar = Lidar()",
    ),
)


def _bundle_frame(exc: BaseException) -> _Frame | None:
    """Returns the innermost line of a bundle that an exception passed through, or is about; None if there is none."""
    if isinstance(exc, SyntaxError) and (frame := _syntax_frame(exc)):
        return frame  # it has passed through no line of the file that it is about
    found, trace = None, exc.__traceback__
    while trace is not None:
        name = str(trace.tb_frame.f_globals.get("__name__", ""))
        if _NAMESPACE.match(name):
            found = _Frame(name, trace.tb_lineno, _source(trace.tb_frame.f_code.co_filename, trace.tb_lineno))
        trace = trace.tb_next
    return found


def _syntax_frame(exc: SyntaxError) -> _Frame | None:
    for root, folder in _bundle_folders().items():
        if exc.filename and exc.lineno and exc.filename.startswith(f"{folder}/"):
            inner = exc.filename.removeprefix(f"{folder}/").removesuffix(".py").replace("/", ".")
            return _Frame(f"{root}.{inner}", exc.lineno, (exc.text or "").strip())
    return None


def _source(file: str, line: int) -> str:
    linecache.checkcache(file)
    return _without_comment(linecache.getline(file, line).strip())


def _without_comment(line: str) -> str:
    """Returns a line of Python without what its author says of it; a part of a statement as it is."""
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(line).readline))
    except (tokenize.TokenError, SyntaxError):
        return line
    end = next((each.start[1] for each in tokens if each.type == tokenize.COMMENT), len(line))
    return line[:end].rstrip()


def _text(exc: BaseException) -> str:
    """Returns an exception's type and words, with paths as the bundle's author knows them."""
    said = _words(exc)
    for folder in _bundle_folders().values():
        said = said.replace(f"{folder}/", "")
    return said


def _words(exc: BaseException) -> str:
    try:
        said = f"{type(exc).__name__}: {exc.msg if isinstance(exc, SyntaxError) else exc}"
        return said.encode(errors="replace").decode()  # names of files may hold halves of characters, and rows may not
    except Exception:  # noqa: BLE001 - an application's exception may not even be able to tell what it is
        return type(exc).__name__


def _bundle_folders() -> dict[str, str]:
    """Returns the folder of each bundle that modules were imported from, by the name of its namespace."""
    roots = ((name, module) for name, module in list(sys.modules.items()) if _NAMESPACE.fullmatch(f"{name}."))
    return {name: next(iter(getattr(module, "__path__", ())), "") for name, module in roots}


def _module_file(name: str) -> str:
    return f"{_NAMESPACE.sub('', name).replace('.', '/')}.py"


class _SourceLoader(SourceFileLoader):
    """Compiles the source of a module, whatever bytecode lies beside it."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _BundleFinder:
    """Finds modules of bundles, and no others: sources, and libraries that are compiled to machine code."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if path is None or not _NAMESPACE.match(fullname):
            return None
        for place in path:
            finder = FileFinder(place, (ExtensionFileLoader, EXTENSION_SUFFIXES), (_SourceLoader, SOURCE_SUFFIXES))
            if found := finder.find_spec(fullname):
                return found
        # Nobody else may look for it: Python's own finder takes bytecode without a source.
        raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


_FINDER = _BundleFinder()


def _import(folder: Path, launch: ApplicationLaunch) -> ModuleType:
    root = f"simyard_bundle_{launch.digest}"
    package = sys.modules.setdefault(root, ModuleType(root))
    package.__path__ = [str(folder)]  # where it lies now: the folder of another store, or unpacked anew
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    sys.dont_write_bytecode = True
    importlib.invalidate_caches()
    return importlib.import_module(f"{root}.{launch.package}.{launch.module}")
