"""Refuses a format of replays whose libraries are not installed; two formats are extras."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Literal

from specs.base import Fault
from specs.errors import DocumentError

Extra = Literal["mcap", "video"]
_MODULES: Mapping[Extra, tuple[str, ...]] = {"mcap": ("mcap",), "video": ("av", "PIL")}


def require_extra(extra: Extra) -> None:
    """Refuses an option whose libraries are not installed here.

    Raises:
        DocumentError: They are not; says what to install.
    """
    if not is_installed(extra):
        allowed = f"with what writes it installed: pip install 'simyard[{extra}]'"
        raise DocumentError([Fault(path=f"--{extra}", value="asked for", allowed=allowed)], source="simyard")


def is_installed(extra: Extra) -> bool:
    """Returns whether an extra's libraries are installed here."""
    return all(find_spec(module) is not None for module in _MODULES[extra])
