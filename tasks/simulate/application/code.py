"""Imports the code of applications from their unpacked bundles, each in a namespace of its own.

A bundle is imported below a package named after its digest, so two versions of an application live side by side in
one process and neither can shadow a library. Modules of a bundle import each other relatively.
"""

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
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


def _import(folder: Path, launch: ApplicationLaunch) -> ModuleType:
    root = f"simyard_bundle_{launch.digest}"
    package = sys.modules.setdefault(root, ModuleType(root))
    package.__path__ = [str(folder)]  # where it lies now: the folder of another store, or unpacked anew
    importlib.invalidate_caches()
    return importlib.import_module(f"{root}.{launch.package}.{launch.launch_file}")
