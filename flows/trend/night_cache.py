"""What ended runs came to, kept in the cache folder: it never changes, and nobody but the owner writes there."""

import hashlib
import logging
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from specs.base import Spec
from tasks.results.trend.night import Night
from tasks.storage.base.atomic_file import whole_file
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

logger = logging.getLogger(__name__)


class KeptNights(Spec):
    """What is known without reading the store.

    Attributes:
        version: Of what a night says; what another version kept is read again.
        documents: Name of the document that each ended run is of, by the run's id.
        nights: Nights of ended runs, by the run's id; None for a run that is no night.
    """

    version: Literal[1] = 1
    documents: dict[str, str] = Field(default_factory=dict[str, str])
    nights: dict[str, Night | None] = Field(default_factory=dict[str, Night | None])


def kept_nights(store: Store, document: str) -> KeptNights:
    """Returns what was kept of a document's nights; nothing if there is no such file, or another version's."""
    path = _path(store, document)
    try:
        return KeptNights.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return KeptNights()
    except OSError as exc:
        logger.warning("%s cannot be read, so that all tables are read again: %s", path, exc)
        return KeptNights()


def keep_nights(store: Store, document: str, kept: KeptNights) -> None:
    """Keeps nights for the next time; a folder that cannot be written costs time and nothing else."""
    path = _path(store, document)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with whole_file(path, 0o600) as file:
            file.write(kept.model_dump_json().encode())
    except OSError as exc:
        logger.warning("%s cannot be written, so that the next trend takes longer: %s", path, exc)


def _path(store: Store, document: str) -> Path:
    name = hashlib.sha256(f"{store.url} {store_id(store)} {document}".encode()).hexdigest()[:16]
    return cache_folder() / "trends" / f"{name}.json"
