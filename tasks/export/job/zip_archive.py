"""All worlds of an export job in one zip, the same bytes for the same worlds.

    manifest.json                       the formats, and SHA-256 and size of every other file
    world/<generation>/<world>.json     the worlds themselves, always
    ...                                 a folder for each format (tasks.export.format.formats)

Files that worlds share, such as models of furniture, stand there once. MJCF comes after all other XML, since
``MjSpec.from_zip`` takes the last it finds.
"""

import hashlib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from pydantic import JsonValue

from specs.data.world import World
from specs.digest import canonical_json
from specs.pipeline.world_sections import WorldFormat
from tasks.export.format.formats import EXPORT_FORMATS
from tasks.export.job.world_files import WorldFiles, world_files

MANIFEST = "manifest.json"

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say
_UNIX = 3
_READ_WRITE = 0o100644 << 16


def write_zip(worlds: Iterable[World | WorldFiles], formats: Collection[WorldFormat], target: Path) -> str:
    """Writes the zip, one world in memory at a time, and returns its SHA-256.

    Args:
        worlds: Taken in their order, on which the bytes depend; or what they became in those formats.
        formats: What each world is written as, beside itself.
        target: A local file, overwritten.

    Raises:
        DocumentError: A world's name or generation may not stand in a path.
        ValueError: A world comes twice.
    """
    wanted: set[WorldFormat] = {*formats, "world"}
    chosen = [each for each in EXPORT_FORMATS.values() if each.name in wanted]
    with ZipFile(target, "w", ZIP_DEFLATED) as file:
        bundle = _Bundle(file)
        seen: set[tuple[str, str]] = set()
        for world in worlds:
            for each in chosen if not seen else ():
                if each.shared_files:
                    bundle.add(each.in_zip(each.shared_files(world.generation, world.name)))
            if (world.generation, world.name) in seen:
                raise ValueError(f"{world.generation}/{world.name} comes twice")
            seen.add((world.generation, world.name))
            bundle.add((world_files(world, formats) if isinstance(world, World) else world).files)
        bundle.close([each.name for each in chosen])
    with target.open("rb") as written:
        return hashlib.file_digest(written, "sha256").hexdigest()


class _Bundle:
    """A zip that lists what is in it."""

    def __init__(self, file: ZipFile) -> None:
        self._file = file
        self._listed: dict[str, JsonValue] = {}

    def add(self, files: Mapping[str, bytes]) -> None:
        """Adds files; one that is there must be the same."""
        for name, body in files.items():
            facts: JsonValue = {"sha256": hashlib.sha256(body).hexdigest(), "bytes": len(body)}
            if name not in self._listed:
                self._listed[name] = facts
                self._write(name, body)
            elif self._listed[name] != facts:
                raise ValueError(f"{name} comes twice, with other bytes")

    def close(self, formats: list[JsonValue]) -> None:
        """Adds the list."""
        self._write(MANIFEST, canonical_json({"formats": formats, "files": self._listed}))

    def _write(self, name: str, body: bytes) -> None:
        info = ZipInfo(name, _EPOCH)
        # Both are otherwise taken from the machine.
        info.create_system = _UNIX
        info.external_attr = _READ_WRITE
        self._file.writestr(info, body, ZIP_DEFLATED)
