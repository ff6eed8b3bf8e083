"""Signed metadata that newer versions have replaced: fleets read only what the newest timestamp leads to."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import cast

from pydantic import JsonValue

from specs.errors import ObjectNotFound
from tasks.housekeeping.object_kinds import METADATA, kind_of_key, metadata_version
from tasks.storage.base.keys import trust_key
from tasks.storage.base.store import Entry, Store

_ROLES = ("targets", "deployer")


def replaced_metadata(store: Store, entries: Sequence[Entry], written_before_s: float) -> frozenset[str]:
    """Returns the keys of metadata in whose place another version has been for long enough.

    Of a repository whose newest versions cannot be told, none.

    Args:
        store: Where it lies.
        entries: All that the store holds.
        written_before_s: When what took its place must have been written at the latest, by the store's clock.
    """
    metadata = [entry for entry in entries if kind_of_key(entry.key).what == METADATA]
    repositories = sorted({metadata_version(entry.key)[0] for entry in metadata})
    current = {repository: _current(store, repository) for repository in repositories}
    written_s = {entry.key: entry.written_s for entry in metadata}
    return frozenset(_replaced(written_s, current, written_before_s))


def _replaced(
    written_s: Mapping[str, float], current: Mapping[str, Mapping[str, int]], before_s: float
) -> Iterable[str]:
    for key in written_s:
        repository, role, version = metadata_version(key)
        newest = current[repository].get(role, 0)
        successor = written_s.get(trust_key(repository, f"{newest}.{role}.json"), before_s)
        if version < newest and successor < before_s:
            yield key


def _current(store: Store, repository: str) -> dict[str, int]:
    """Returns the version of each role that counts."""
    try:
        snapshot = _versions(store, trust_key(repository, "timestamp.json"))["snapshot"]
        found = _versions(store, trust_key(repository, f"{snapshot}.snapshot.json"))
        return {"snapshot": snapshot, **{role: found[role] for role in _ROLES}}
    except (ObjectNotFound, ValueError, KeyError, TypeError, AttributeError):
        return {}  # a robot says what is wrong with it; housekeeping leaves it alone


def _versions(store: Store, key: str) -> dict[str, int]:
    document = cast("dict[str, dict[str, dict[str, dict[str, JsonValue]]]]", json.loads(store.get(key).body))
    meta = document["signed"]["meta"]
    return {name.removesuffix(".json"): int(str(found["version"])) for name, found in meta.items()}
