"""The files of one world, made here or by a worker elsewhere, and all worlds of an export job in one zip.

    manifest.json                       the formats, and SHA-256 and size of every other file
    world/<generation>/<world>.json     the worlds themselves, always
    ...                                 a folder for each format (tasks.export.format.formats)

Files that worlds share, such as models of furniture, stand there once. MJCF comes after all other XML, since
``MjSpec.from_zip`` takes the last it finds.
"""

import hashlib
import io
import logging
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile, ZipInfo

from pydantic import JsonValue

from specs.base import canonical_json
from specs.data.world import World
from specs.errors import DocumentError, ObjectNotFound
from specs.pipeline.world_sections import WorldFormat
from tasks.export.format.formats import EXPORT_FORMATS, format_files
from tasks.storage.base.keys import export_part_key, export_parts_prefix
from tasks.storage.base.store import Store
from tasks.storage.worlds import read_world

# What a network carries is smaller by far, and the zip itself packs it anew: its bytes are those of one machine's zlib.
_LIGHTLY = 1
SOURCE = "CreateWorldExportJob"
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class WorldFiles:
    """What a world becomes in an export.

    Attributes:
        generation: The world's generation job.
        name: The world's name.
        files: By path in the zip, in the order in which they stand there.
    """

    generation: str
    name: str
    files: Mapping[str, bytes]


def world_files(world: World, formats: Collection[WorldFormat]) -> WorldFiles:
    """Returns the files of a world in each of the formats, and the world itself.

    Raises:
        DocumentError: The world's name or generation may not stand in a path.
    """
    wanted = {*formats, "world"}
    files: dict[str, bytes] = {}
    for each in EXPORT_FORMATS:
        if each in wanted:
            files |= format_files(world, each)
    return WorldFiles(world.generation, world.name, files)


def make_parts(
    store: Store, job: str, references: Sequence[str], formats: Collection[WorldFormat], going: Callable[[], bool]
) -> None:
    """Keeps what worlds become, unless nobody wants them any more.

    A world that cannot be written is left to whoever writes the zip, and ends the job there.

    Args:
        store: Where worlds lie.
        job: The export job.
        references: ``<generation>/<world>`` of each world.
        formats: What each is written as.
        going: Whether the next one is still wanted; asked before each.
    """
    for reference in references:
        if not going():
            return
        try:
            keep_part(store, job, world_files(read_world(store, reference, SOURCE), formats))
        except DocumentError as exc:
            _log.warning("%s: %s is not written: %s", job, reference, exc)


def keep_part(store: Store, job: str, part: WorldFiles) -> None:
    """Keeps the files of a world for whoever writes the zip; done twice, the same is kept."""
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED, compresslevel=_LIGHTLY) as file:
        for name, body in part.files.items():
            file.writestr(name, body)
    store.put(export_part_key(job, part.generation, part.name), packed.getvalue())


def kept_part(store: Store, job: str, reference: str) -> WorldFiles | None:
    """Returns what was kept of a world, ``<generation>/<world>``; None if nothing was, or it does not unpack."""
    generation, name = reference.split("/")
    try:
        body = store.get(export_part_key(job, generation, name)).body
        with ZipFile(io.BytesIO(body)) as file:
            return WorldFiles(generation, name, {each: file.read(each) for each in file.namelist()})
    except (ObjectNotFound, BadZipFile):
        return None


def kept_parts(store: Store, job: str) -> set[str]:
    """Returns ``<generation>/<world>`` of each world whose files are kept."""
    folder = f"{export_parts_prefix(job)}/"
    return {key.removeprefix(folder).removesuffix(".zip") for key in store.keys(folder.rstrip("/"))}


def drop_parts(store: Store, job: str) -> None:
    """Removes all that was kept for an export job."""
    for key in store.keys(export_parts_prefix(job)):
        store.delete(key)


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
