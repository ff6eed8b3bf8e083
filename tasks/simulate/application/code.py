"""Imports the code of applications from their unpacked bundles, each in a namespace of its own.

A bundle is imported below a package named after its digest, so two versions of an application live side by side in
one process and neither can shadow a library. Modules of a bundle import each other relatively.

What runs is what the sources say: bytecode (``__pycache__``, ``.pyc``) in a bundle is never read, since it may be of
other sources, and none is written.
"""

import importlib
import re
import sys
from collections.abc import Callable, Sequence
from importlib.machinery import (
    EXTENSION_SUFFIXES,
    SOURCE_SUFFIXES,
    ExtensionFileLoader,
    FileFinder,
    ModuleSpec,
    SourceFileLoader,
)
from pathlib import Path
from types import CodeType, ModuleType
from typing import Literal, ParamSpec, TypeVar

from specs.data.episode import ApplicationLaunch, Failure
from specs.errors import SimyardError

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
    module = call_bundle(
        code, f"{launch.name}: importing {launch.package}/{launch.launch_file}.py", _import, folder, launch
    )
    found = getattr(module, factory, None)
    if not callable(found):
        raise BundleCrash(
            code, f"{launch.name}: {launch.package}/{launch.launch_file}.py defines no function {factory}(environment)"
        )
    return found


def call_bundle(code: CrashCode, doing: str, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Returns what an application's function returns.

    Raises:
        BundleCrash: The function raised.
    """
    try:
        return function(*args, **kwargs)
    except Exception as exc:  # an application may raise anything, and it is a row, not our failure
        raise BundleCrash(code, f"{doing}: {type(exc).__name__}: {exc}") from exc


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
    return importlib.import_module(f"{root}.{launch.package}.{launch.launch_file}")
