"""Makes a batch's report from its tables and worlds in the store, and puts the page beside the tables."""

import hashlib
import logging
import tempfile
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from specs.data.world import Room
from specs.errors import ObjectNotFound, WorldChanged
from specs.field_types import OutputLocation
from tasks.results.report.facts import BatchFacts
from tasks.results.report.places import Worlds
from tasks.results.report.view import ReportView, report_view
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE
from tasks.results.tables.stored_rows import require_as_written
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.keys import output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.worlds import decode_world, pinned_world_bytes, world_bytes

logger = logging.getLogger(__name__)
REPORT_FILE = "report.html"
# Reading so many takes a second or two; of more, rooms and maps are told of the first ones alone.
MOST_WORLDS = 2_000


class _Rooms(BaseModel):
    """The part of a world that is wanted of every one; all of them as a whole would fill the memory."""

    model_config = ConfigDict(extra="ignore")

    rooms: tuple[Room, ...]


def batch_view(store: Store, facts: BatchFacts, location: OutputLocation) -> ReportView:
    """Returns what a batch's report shows.

    Args:
        store: The store of the batch.
        facts: What its records say.
        location: Where its tables lie.

    Raises:
        ObjectNotFound: A table is gone.
        StageFailed: A table is not the one that the batch wrote, whose SHA-256 the page names.
        StoreError: The store or the bucket cannot be read.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    with tempfile.TemporaryDirectory(prefix="simyard-report-") as folder:
        results, failures = Path(folder) / RESULTS_FILE, Path(folder) / FAILURES_FILE
        for path in (results, failures):
            key = file_key(location, facts.batch, path.name)
            bucket.download(key, path)
            _require_as_written(path, facts, f"{bucket.url}/{key}")
        return report_view(facts, results, failures, stored_worlds(store, facts))


def put_report(store: Store, location: OutputLocation, batch: str, page: bytes) -> str:
    """Writes the page beside the batch's tables, and returns its URL.

    Args:
        store: The store of the batch.
        location: Where its tables lie.
        batch: The batch's id.
        page: The page.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    key = file_key(location, batch, REPORT_FILE)
    bucket.put(key, page)
    return f"{bucket.url}/{key}"


def file_key(location: OutputLocation, batch: str, name: str) -> str:
    """Returns the key of one of a batch's files in its bucket."""
    return output_key(location.s3Prefix, f"{checked_name(batch, 'batch')}/{name}")


def stored_worlds(store: Store, facts: BatchFacts) -> Worlds:
    """Returns a batch's worlds, without those that are gone or no longer what the batch ran in."""
    rooms: dict[str, tuple[Room, ...]] = {}
    for name, digest in list(facts.worlds.items())[:MOST_WORLDS]:
        found = _rooms(store, name, digest)
        if found is not None:
            rooms[name] = found
    return Worlds(rooms, lambda name: decode_world(world_bytes(store, name)))


def _require_as_written(path: Path, facts: BatchFacts, url: str) -> None:
    named = next((link.sha256 for link in facts.links if link.label == path.name), "")
    if named:
        with path.open("rb") as file:
            require_as_written(hashlib.file_digest(file, "sha256").hexdigest(), named, url)


def _rooms(store: Store, name: str, digest: str) -> tuple[Room, ...] | None:
    try:
        return _Rooms.model_validate_json(pinned_world_bytes(store, name, digest)).rooms
    except (ObjectNotFound, ValidationError) as exc:
        logger.warning("world %s is left out of the report: %s", name, exc)
    except WorldChanged:
        logger.warning("world %s is left out of the report: it is not the one that the batch ran in", name)
    return None
