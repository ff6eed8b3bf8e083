"""All worlds of an export job in one zip, the same bytes for the same worlds.

manifest.json                               SHA-256 and size of every other file
worlds/<generation>/<world>/world.json      the world itself, as the store has it
worlds/<generation>/<world>/world.xml       MJCF, with format mjcf
worlds/<generation>/<world>/textures/*.png  what its floors and walls look like
worlds/<generation>/<world>/floorplan.svg   with format svg
"""

import hashlib
from collections.abc import Collection, Iterable
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from pydantic import JsonValue

from specs.digests import canonical_document, canonical_json
from specs.pipeline_worlds import WorldFormat
from specs.world import World
from tasks.export.mjcf import mjcf_files
from tasks.export.svg import floor_plan_svg
from tasks.storage.keys import checked_name

MANIFEST = "manifest.json"
WORLD_FILE = "world.json"
PLAN_FILE = "floorplan.svg"

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say
_UNIX = 3
_READ_WRITE = 0o100644 << 16


def world_files(world: World, formats: Collection[WorldFormat]) -> dict[str, bytes]:
    """Returns the files of one world by their names: the world itself, then the formats asked for."""
    files = {WORLD_FILE: canonical_json(canonical_document(world))}
    if "mjcf" in formats:
        files |= mjcf_files(world)
    if "svg" in formats:
        files[PLAN_FILE] = floor_plan_svg(world).encode()
    return files


def write_zip(worlds: Iterable[World], formats: Collection[WorldFormat], target: Path) -> str:
    """Writes the zip, one world in memory at a time, and returns its SHA-256.

    Args:
        worlds: Taken in their order; the bytes depend on it.
        formats: What each world is written as, beside itself.
        target: A local file, overwritten.

    Raises:
        DocumentError: A world's name or generation may not stand in a path.
        ValueError: A world comes twice.
    """
    listed: dict[str, JsonValue] = {}
    with ZipFile(target, "w", ZIP_DEFLATED) as bundle:
        for world in worlds:
            folder = f"worlds/{checked_name(world.generation, 'generation')}/{checked_name(world.name, 'world')}"
            if f"{folder}/{WORLD_FILE}" in listed:
                raise ValueError(f"{folder} comes twice")
            for name, body in world_files(world, formats).items():
                _add(bundle, f"{folder}/{name}", body)
                listed[f"{folder}/{name}"] = {"sha256": hashlib.sha256(body).hexdigest(), "bytes": len(body)}
        _add(bundle, MANIFEST, canonical_json({"formats": [*sorted(formats)], "files": listed}))
    with target.open("rb") as written:
        return hashlib.file_digest(written, "sha256").hexdigest()


def _add(bundle: ZipFile, name: str, body: bytes) -> None:
    info = ZipInfo(name, _EPOCH)
    # Both are otherwise taken from the machine.
    info.create_system = _UNIX
    info.external_attr = _READ_WRITE
    bundle.writestr(info, body, ZIP_DEFLATED)
