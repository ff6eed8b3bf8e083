"""Refuses a format of replays whose libraries are not installed; formats beside the drawing are extras."""

from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from typing import Literal

from specs.errors import DocumentError
from specs.field_types import BagFormat

Extra = Literal["mcap", "ros", "video"]
_MODULES: Mapping[Extra, tuple[str, ...]] = {
    "mcap": ("mcap",),
    "ros": ("mcap", "rosbags"),
    "video": ("av", "PIL"),
}


def require_extra(extra: Extra, path: str, value: str = "asked for") -> None:
    """Refuses what is asked for if its libraries are not installed here.

    Args:
        extra: That has the libraries.
        path: Where it is asked for: an option, or a field of a document.
        value: What stands there.

    Raises:
        DocumentError: They are not; says what to install.
    """
    if not is_installed(extra):
        allowed = f"with what writes it installed: pip install 'simyard[{extra}]'"
        raise DocumentError.of(path, value, allowed, source="simyard")


def is_installed(extra: Extra) -> bool:
    """Returns whether an extra's libraries are installed here."""
    return all(find_spec(module) is not None for module in _MODULES[extra])


def require_bag_writers(asked: Iterable[BagFormat] | None) -> None:
    """Refuses bags that a document asks for if nothing here can write them.

    Raises:
        DocumentError: Says what to install.
    """
    if first := next(iter(asked or ()), ""):
        require_extra("ros", "simulationBatch.recordings.bags", first)
