"""Where a caller says that a store is: a URL, or a folder as a path."""

import os
from pathlib import Path


def store_url(place: str | os.PathLike[str] | None) -> str | None:
    """Returns the URL of a store.

    Args:
        place: A URL or a folder; None means SIMYARD_STORE, else ``.simyard`` in the working directory.
    """
    if place is None or (isinstance(place, str) and "://" in place):
        return place
    return Path(place).resolve().as_uri()
