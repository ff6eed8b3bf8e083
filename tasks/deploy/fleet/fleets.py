"""Fleets in the store. A fleet's record names its one active deployment."""

import time
from collections.abc import Mapping
from pathlib import PurePosixPath

from specs.arn import absence, parse_reference
from specs.base import Fault
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ResourceNotFound
from tasks.deploy.fleet.damaged_records import read_listed
from tasks.deploy.fleet.states import FleetRecord
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.keys import fleet_key
from tasks.storage.base.store import Store
from tasks.storage.tags import Change

_FLEETS = "fleets"


def create_fleet(store: Store, name: str, tags: Mapping[str, str] | None = None) -> FleetRecord:
    """Returns the fleet of that name, made if there is none; an old one keeps its tags.

    Raises:
        DocumentError: The name is none.
    """
    record = FleetRecord(name=name, created_at_s=time.time(), tags=dict(tags or {}))
    while True:
        try:
            store.create(fleet_key(name), encode_document(record))
        except ObjectExists:
            found, etag = read_fleet(store, name, deleted=True)
            if not found.deleted:
                return found
            try:
                store.replace(fleet_key(name), encode_document(record), etag)
            except ObjectConflict:  # its deletion is done now
                continue
        return record


def read_fleet(store: Store, reference: str, *, deleted: bool = False) -> tuple[FleetRecord, str]:
    """Returns a fleet and its etag, by name or ARN; one that is being deleted only if asked for.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: The reference is no fleet's.
    """
    name = fleet_name(reference)
    key = fleet_key(name)
    try:
        stored = store.get(key)
    except ObjectNotFound as exc:
        raise _missing(reference, absence(["deployment-fleet"], store.url)) from exc
    record = decode_document(FleetRecord, stored, store, key)
    if record.deleted and not deleted:
        raise _missing(reference, f"a fleet in {store.url}; this one is being deleted")
    return record, stored.etag


def change_fleet_tags(store: Store, reference: str, change: Change) -> FleetRecord:
    """Returns a fleet after its tags were changed, over exactly what was read.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: There would be too many.
    """
    while True:
        record, etag = read_fleet(store, reference)
        changed = record.model_copy(update={"tags": change(record.tags)})
        try:
            store.replace(fleet_key(record.name), encode_document(changed), etag)
        except ObjectConflict:
            continue
        return changed


def fleets(store: Store) -> list[FleetRecord]:
    """Returns all fleets, oldest first; one with a damaged record is left out, and named in the log."""
    found = [
        fleet for key in store.keys(_FLEETS) if (fleet := read_listed(store, key, FleetRecord, PurePosixPath(key).stem))
    ]
    return sorted((fleet for fleet in found if not fleet.deleted), key=lambda fleet: (fleet.created_at_s, fleet.name))


def fleet_name(reference: str) -> str:
    """Returns the name of the fleet that a plain name or an ARN refers to.

    Raises:
        ResourceNotFound: An ARN of something else.
    """
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise _missing(reference, str(exc)) from exc
    if parsed.kind not in {None, "deployment-fleet"}:
        raise _missing(reference, "the name or ARN of a deployment-fleet")
    return parsed.path


def _missing(reference: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound([Fault(path="fleet", value=repr(reference), allowed=allowed)])
