"""The files of modules that come neither from a bundle nor from an installed library nor from Simyard.

An application may import one that a person works on, from a folder on PYTHONPATH: a program that was traced with it is
out of date when it changes, and no version says so.
"""

import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

import specs
import tasks.simulate
from tasks.simulate.engine.kept_program.kept_file import Dependency, file_digest

_BUNDLE = "simyard_bundle_"
_INSTALLED = ("site-packages", "dist-packages")


def module_dependencies() -> tuple[Dependency, ...]:
    """Returns the files of all modules that were imported from elsewhere, as they are now."""
    return tuple(Dependency(path=str(path), sha256=file_digest(path)) for path in sorted(set(_elsewhere())))


def _elsewhere() -> Iterator[Path]:
    known = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib")]
    known += [specs.__path__[0], tasks.simulate.__path__[0]]
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if not isinstance(file, str) or name.startswith(_BUNDLE):
            continue
        path = Path(file)
        if not any(path.is_relative_to(folder) for folder in known) and not set(_INSTALLED) & set(path.parts):
            yield path
