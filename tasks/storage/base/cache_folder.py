"""The folder for what can be made again: compiled programs, unpacked bundles, Simyard's own Prefect database."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Returns SIMYARD_CACHE, else ``simyard`` in the user's cache folder (XDG base directory specification)."""
    chosen = os.environ.get("SIMYARD_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "simyard"
