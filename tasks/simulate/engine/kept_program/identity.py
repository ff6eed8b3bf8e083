"""What a program follows from: the applications' files and settings, Simyard's own source, libraries, and devices.

An application is a function of its bundle, of its environment and of its data sources, so that these are enough. What
else it reads of this machine while it is traced is not looked for, but for modules (``module_files``).
"""

import functools
import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import jax

import specs
import tasks.simulate
from specs.data.episode import ApplicationLaunch
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.sealed_bundle import FILES_FOLDER

_SETTINGS = ("JAX_", "XLA_", "TF_", "LIBTPU_", "MUJOCO_")
# Where programs lie changes none of them.
_NO_MATTER = ("jax_compilation_cache_dir", "JAX_COMPILATION_CACHE_DIR")


def applications_identity(
    launches: Iterable[ApplicationLaunch], folders: Iterable[Path], names: Sequence[str], texts: Mapping[str, str]
) -> str:
    """Returns what two applications' part of a program follows from; empty where that cannot be told.

    Args:
        launches: The applications.
        folders: Where their bundles are unpacked.
        names: Of the numeric environment variables.
        texts: The other ones. One that names a file which is no data source could hold anything.
    """
    if any(map(_names_a_file, texts.values())):
        return ""
    bundles = [
        (launch.digest, launch.package, launch.launch_file, _content(folder))
        for launch, folder in zip(launches, folders, strict=True)
    ]
    return json.dumps([bundles, list(names), sorted(texts.items())])


@functools.cache
def machine_identity() -> str:
    """Returns what every program of this process follows from, as one digest."""
    settings = {name: value for name, value in os.environ.items() if name.startswith(_SETTINGS)}
    settings |= {name: repr(value) for name, value in jax.config.values.items()}
    for name in _NO_MATTER:
        settings.pop(name, None)
    devices = [(each.platform, each.device_kind, each.client.platform_version) for each in jax.devices()]
    told = [sys.version, platform.machine(), _libraries(), _source_digest(), sorted(settings.items()), devices]
    return _digest(json.dumps(told))


def _source_digest() -> str:
    """Returns a digest of what simulates: a change of any module of it may change a program."""
    roots = (Path(specs.__path__[0]), Path(tasks.simulate.__path__[0]))
    return _folder_digest(path for root in roots for path in root.rglob("*.py"))


def _libraries() -> list[str]:
    """Returns all that is installed, each with its version, as the names of their metadata say."""
    folders = [Path(folder) for folder in sys.path if Path(folder).is_dir()]
    return sorted({path.name for folder in folders for path in folder.glob("*.dist-info")})


def _content(folder: Path) -> str:
    """Returns a digest of a bundle's files; empty of one that is sealed: it holds what its own digest says."""
    if folder.name == FILES_FOLDER:
        return ""
    return _folder_digest(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc")


def _folder_digest(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(paths):
        body = path.read_bytes()
        digest.update(f"{path} {len(body)}\n".encode() + body)
    return digest.hexdigest()


def _names_a_file(text: str) -> bool:
    """Returns whether a text is the path of something that another text may stand for tomorrow.

    A mounted data source lies in a folder that its digest names.
    """
    if "/" not in text or "\0" in text:
        return False
    path = Path(text)
    try:
        return path.exists() and not path.is_relative_to(cache_folder() / "data" / "mounts")
    except OSError:  # too long to be one
        return False


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
