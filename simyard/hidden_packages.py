"""Refuses to go on where a file of the user's hides one of Simyard's packages, and says which and what to do.

Python takes the first `tasks` on its path. A script's folder comes first there, so that a `tasks.py` beside a script
would be imported in the place of Simyard's, and fail somewhere deep inside it with a message that names neither.
"""

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

from simyard.start import is_command

PACKAGES = ("flows", "tasks", "specs")
_OWN = Path(__file__).resolve().parent.parent
_REFUSED = 2  # as flows.cli.terminal has it, which may be what is hidden


def require_own_packages() -> None:
    """Lets a program go on that finds Simyard's packages, and not others of the same names.

    Raises:
        ImportError: Something hides one of them.
        SystemExit: The same, in the command `simyard`: with 2, as for each wrong command, because 1 is a gate's FAIL.
    """
    for name in PACKAGES:
        own, loaded = _OWN / name, sys.modules.get(name)
        found = _place(loaded) if loaded else _place(PathFinder.find_spec(name))
        if found is not None and found != own:
            message = _message(name, found, own, loaded=loaded is not None)
            if is_command():
                sys.stderr.write(f"{message}\n")
                raise SystemExit(_REFUSED)
            raise ImportError(message, name=name, path=str(found))


def _place(found: ModuleType | ModuleSpec | None) -> Path | None:
    """Returns the folder of a package or the file of a module; None for what is not there."""
    spec = found.__spec__ if isinstance(found, ModuleType) else found
    if spec is None:
        return Path(f"<{found.__name__}>") if isinstance(found, ModuleType) else None
    folders = list(spec.submodule_search_locations or ())
    place = Path(folders[0] if folders else spec.origin or f"<{spec.name}>")
    return place.resolve()


def _message(name: str, found: Path, own: Path, *, loaded: bool) -> str:
    if loaded:
        what = f"this program has imported {found} as `{name}`, which is the name of a package of Simyard's, {own}"
        return f"{what}. A program has one `{name}`: rename yours, such as to `my_{name}`, and restart Python"
    what = f"{found} hides Simyard's package `{name}`, {own}"
    return f"{what}. Rename yours, such as to `my_{name}`{_other_remedy(found.parent)}"


def _other_remedy(folder: Path) -> str:
    """Returns what else helps, by the way on which Python came to look into a folder."""
    set_by_user = os.environ.get("PYTHONPATH", "")
    if set_by_user and folder in _folders(set_by_user.split(os.pathsep)):  # an empty one names no folder
        return f", or take {folder} out of PYTHONPATH"
    if sys.path and folder in _folders(sys.path[:1]) and not sys.flags.safe_path:
        return ", or start Python with -P (or PYTHONSAFEPATH=1), which leaves the folder of a script out of its path"
    return f", or put {folder} behind {_OWN} in sys.path"


def _folders(entries: list[str]) -> set[Path]:
    return {Path(entry or ".").resolve() for entry in entries}
