"""The folder for what can be made again: compiled programs, unpacked bundles, Simyard's own Prefect database."""

import os
from collections.abc import Mapping
from pathlib import Path


def cache_folder() -> Path:
    """Returns SIMYARD_CACHE, else ``simyard`` in the user's cache folder (XDG base directory specification)."""
    return chosen_folder(os.environ)


def chosen_folder(environment: Mapping[str, str]) -> Path:
    """Returns the cache folder of a process with these variables."""
    chosen = environment.get("SIMYARD_CACHE")
    if chosen:
        return Path(chosen)
    home = environment.get("HOME") or Path.home()
    return Path(environment.get("XDG_CACHE_HOME") or Path(home) / ".cache") / "simyard"
