"""The files that an MJCF names: only such as lie in its bundle, and are not too large once they are decoded.

Where MuJoCo looks for a file depends on the folders of `compiler`, on the file that names it, and on `strippath`. Here
a name stands for every file of the bundle that it could be, so that none is forgotten.
"""

import os
import re
import struct
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from tasks.simulate.application.mjcf_numbers import made_pixels
from tasks.simulate.application.mjcf_xml import Element, shown
from tasks.simulate.refusal import MjcfRefused

_FILES: Mapping[str, tuple[str, ...]] = {
    "include": ("file",),
    "mesh": ("file",),
    "hfield": ("file",),
    "skin": ("file",),
    "model": ("file",),
    "flexcomp": ("file",),
    "texture": ("file", "fileback", "filedown", "filefront", "fileleft", "fileright", "fileup"),
    "compiler": ("assetdir", "meshdir", "texturedir"),
}
_MOST_ENTRIES = 20_000
_MOST_BYTES = 64 << 20
_MOST_PIXELS = 4_096 * 24_576
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_SIZE = struct.Struct(">II")
_HEIGHTS = struct.Struct("<ii")
# A scheme, as MuJoCo's resource providers have, or a drive.
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


class BundleFiles:
    """The files of a bundle, looked up by the names that an MJCF gives them."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._pixels = 0.0

    def check(self, element: Element) -> None:
        """Refuses an element that names a file outside the bundle, a link, or one that decodes to too much.

        Raises:
            MjcfRefused: It does.
        """
        for name in _FILES.get(element.tag, ()):
            given = element.attributes.get(name, "")
            climbs = ".." in given.split("/") or given.startswith("/") or "\\" in given
            if climbs or _SCHEME.match(given) or not given.isprintable():
                allowed = "must be a path inside the bundle, without `..`, `\\` and `:`"
                raise element.refusal(f"{name} {shown(given)}: {allowed}")
            for path in self.found(given):
                self._spend(element, _pixels_of(element, name, path))
        self._spend(element, made_pixels(element))

    def _spend(self, element: Element, pixels: float) -> None:
        self._pixels += pixels
        if self._pixels > _MOST_PIXELS:
            raise element.refusal(f"pictures and shapes of more than {_MOST_PIXELS:,} points in all")

    def found(self, given: str) -> list[Path]:
        """Returns every file of the bundle that a relative path may stand for."""
        return self._by_name.get(Path(given).name, []) if given else []

    def name(self, path: Path) -> str:
        """Returns what messages call a file."""
        return path.relative_to(self._root).as_posix()

    @cached_property
    def _by_name(self) -> Mapping[str, list[Path]]:
        found: dict[str, list[Path]] = {}
        entries = 0
        for base, folders, names in os.walk(self._root):
            entries += len(folders) + len(names)
            if entries > _MOST_ENTRIES:
                raise MjcfRefused(f"more than {_MOST_ENTRIES:,} files in the bundle")
            for name in (*folders, *names):
                path = Path(base, name)
                if path.is_symlink():
                    raise MjcfRefused(f"{shown(self.name(path))}: a link in the bundle; copy what it points to")
                if path.is_file():
                    found.setdefault(name, []).append(path)
        return found


def _pixels_of(element: Element, name: str, path: Path) -> int:
    """Returns how many points a file decodes to; refuses one that is too large."""
    given = shown(element.attributes[name])
    try:
        size_bytes = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(24)
    except OSError as exc:
        raise element.refusal(f"{name} {given}: cannot be read: {type(exc).__name__}") from exc
    if size_bytes > _MOST_BYTES:
        raise element.refusal(f"{name} {given}: larger than {_MOST_BYTES:,} bytes")
    return _decoded(element.tag, head)


def _decoded(tag: str, head: bytes) -> int:
    """Returns how many pixels a picture, or heights a field of them, holds, as its beginning says; 0 for others."""
    if head.startswith(_PNG) and len(head) == 24:
        width, height = _PNG_SIZE.unpack(head[16:24])
        return width * height
    if tag == "hfield" and len(head) >= _HEIGHTS.size:
        rows, columns = _HEIGHTS.unpack(head[: _HEIGHTS.size])
        return abs(rows) * abs(columns)
    return 0
