"""Tells which worlds have the same content, whatever their generation is called."""

import hashlib
import json
from collections.abc import Mapping

from specs.base import canonical_json
from specs.errors import ObjectNotFound, WorldChanged
from tasks.storage.base.store import Store
from tasks.storage.worlds import pinned_world_bytes


def world_identities(store: Store, worlds: Mapping[str, str]) -> dict[str, str]:
    """Returns what tells worlds apart, by ``<generation>/<world>``: all of each but what its generation was called.

    A world that is gone, or is not what it was, is the same as one whose whole document was the same.

    Args:
        store: Where they are.
        worlds: SHA-256 of each world's document as it was, by ``<generation>/<world>``.
    """
    return {reference: _identity(store, reference, digest) for reference, digest in worlds.items()}


def world_differences(store: Store, worlds: Mapping[str, str]) -> dict[str, str]:
    """Returns what tells the worlds of one batch apart; nothing where their names do, so that none is read.

    Worlds of one generation have names of their own, which are part of what is in them.
    """
    several = len({reference.partition("/")[0] for reference in worlds}) > 1
    return world_identities(store, worlds) if several else {}


def _identity(store: Store, reference: str, digest: str) -> str:
    try:
        body = pinned_world_bytes(store, reference, digest)
    except (ObjectNotFound, WorldChanged):
        return digest
    return hashlib.sha256(canonical_json({**json.loads(body), "generation": ""})).hexdigest()
