"""Environment variables that no file of a batch's applications names: they are probably misspelt.

A name that a program puts together, or that a package outside the bundle reads, is not seen. So this is no fault of a
document.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from specs.rules import meant

_QUOTED = re.compile(rb"""["']([A-Z][A-Z0-9_]+)["']""")
_NAMELESS = frozenset({".stl", ".obj", ".png", ".jpg", ".jpeg", ".dae", ".glb", ".msh"})
"""Endings of files that hold shapes and pictures."""
_OF_LIBRARIES = (
    "ROS_",
    "RMW_",
    "RCUTILS_",
    "RCL_",
    "CYCLONEDDS_",
    "FASTRTPS_",
    "FASTDDS_",
    "PYTHON",
    "JAX_",
    "OMP_",
    "LD_",
)
"""How the names of variables begin that libraries read."""
_MOST_BYTES = 1 << 20
"""Of a file; a larger one, such as a mesh or a network, might name anything, and nothing is said then."""


def unread_variables(bundles: Mapping[str, Path], variables: Iterable[str]) -> Iterator[str]:
    """Yields for each variable that no file of the bundles names a sentence that says so.

    Args:
        bundles: Unpacked folders, by the names of their applications.
        variables: The names that episodes set.
    """
    inside = (file for folder in bundles.values() for file in folder.rglob("*") if file.suffix not in _NAMELESS)
    files = [file for file in inside if file.is_file()]
    if any(file.stat().st_size > _MOST_BYTES for file in files):
        return
    texts = [file.read_bytes() for file in files]
    words = {word for text in texts for word in re.findall(rb"[A-Za-z0-9_]+", text)}
    known = {name.decode() for text in texts for name in _QUOTED.findall(text)}
    for name in variables:
        if name.encode() not in words and not name.startswith(_OF_LIBRARIES):
            hint = meant(name, sorted(known)).strip()
            yield f"{name}: no file of {' or '.join(sorted(bundles))} has this name" + (f"; {hint}" if hint else "")
