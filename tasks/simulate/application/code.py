"""Imports the code of applications from their unpacked bundles, each in a namespace of its own.

A bundle is imported below a package named after its digest, so two versions of an application live side by side in
one process and neither can shadow a library. Modules of a bundle import each other relatively.
"""

import importlib
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Literal, ParamSpec, TypeVar

from specs.data.episode import ApplicationLaunch, Failure
from specs.errors import SimyardError
from tasks.simulate.application.call_clock import CallKind, timed_call

CrashCode = Literal["RobotApplicationCrash", "SimulationApplicationCrash"]
_REASON_LENGTH = 1000
_NAMESPACE = re.compile(r"simyard_bundle_[0-9a-f]{64}\.")
P = ParamSpec("P")
R = TypeVar("R")


class BundleCrash(SimyardError):  # noqa: N818 - RoboMaker's name
    """An application's own code failed.

    Attributes:
        code: RoboMaker's failure code.
        reason: The exception, for a person, as one line.
    """

    def __init__(self, code: CrashCode, reason: str) -> None:
        self.code: CrashCode = code
        # One line, as RoboMaker's reasons are, and with the author's module names instead of the bundle's namespace.
        self.reason = " ".join(_NAMESPACE.sub("", reason).split())[:_REASON_LENGTH]
        super().__init__(f"{code}: {self.reason}")

    @property
    def failure(self) -> Failure:
        """Returns both together."""
        return Failure(self.code, self.reason)


def load_factory(
    folder: Path, launch: ApplicationLaunch, factory: Literal["controller", "scenario"], code: CrashCode
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
    doing = f"{launch.name}: importing {launch.package}/{launch.launch_file}.py"
    module = _called("import", code, doing, lambda: _import(folder, launch))
    found = getattr(module, factory, None)
    if not callable(found):
        raise BundleCrash(
            code, f"{launch.name}: {launch.package}/{launch.launch_file}.py defines no function {factory}(environment)"
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
    name, place = _bundle_frame(exc)
    said = _text(exc)
    for code, launch in launches.items():
        if launch.digest in (name or said):
            return BundleCrash(code, f"{launch.name}: {said}{place}")
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
        raise BundleCrash(code, f"{doing}: {_text(exc)}{_bundle_frame(exc)[1]}") from exc


def _bundle_frame(exc: BaseException) -> tuple[str, str]:
    """Returns the innermost module of a bundle that an exception passed through, and its `` (file, line n)``."""
    found, trace = ("", ""), exc.__traceback__
    while trace is not None:
        name = str(trace.tb_frame.f_globals.get("__name__", ""))
        if _NAMESPACE.match(name):
            found = name, f" ({_module_file(name)}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return found


def _text(exc: BaseException) -> str:
    try:
        return f"{type(exc).__name__}: {exc}"
    except Exception:  # noqa: BLE001 - an application's exception may not even be able to tell what it is
        return type(exc).__name__


def _module_file(name: str) -> str:
    return f"{_NAMESPACE.sub('', name).replace('.', '/')}.py"


def _import(folder: Path, launch: ApplicationLaunch) -> ModuleType:
    root = f"simyard_bundle_{launch.digest}"
    package = sys.modules.setdefault(root, ModuleType(root))
    package.__path__ = [str(folder)]  # where it lies now: the folder of another store, or unpacked anew
    importlib.invalidate_caches()
    return importlib.import_module(f"{root}.{launch.package}.{launch.launch_file}")
