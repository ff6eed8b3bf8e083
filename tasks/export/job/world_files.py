"""The files of one world, as they go into the zip: made here, or by a worker elsewhere and kept for the zip."""

import io
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile

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
