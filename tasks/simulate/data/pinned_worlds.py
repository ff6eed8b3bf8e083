"""Worlds as they were when a batch was planned, from its store."""

import functools
from collections.abc import Iterable, Mapping

from specs.data.episode import EpisodeRequest, Failure
from specs.data.world import World
from specs.errors import ObjectNotFound, WorldChanged
from tasks.storage.store_url import open_store
from tasks.storage.worlds import decode_world, pinned_world_bytes

# As many as a chunk of the default size has at most.
_WORLDS_KEPT = 256


def pinned_worlds(
    store_url: str, digests: Mapping[str, str], requests: Iterable[EpisodeRequest]
) -> tuple[dict[str, World], dict[str, Failure]]:
    """Returns the worlds of episodes, and why others of them cannot be used.

    Args:
        store_url: Where they are.
        digests: SHA-256 of each world's document when the batch was planned, by ``<generation>/<world>``.
        requests: The episodes.
    """
    worlds: dict[str, World] = {}
    missing: dict[str, Failure] = {}
    for reference in dict.fromkeys(request.world for request in requests):
        try:
            worlds[reference] = _world(store_url, reference, digests[reference])
        except ObjectNotFound:
            missing[reference] = Failure("InvalidS3Resource", f"world {reference} does not exist")
        except WorldChanged:
            why = f"world {reference} is not what it was when the batch was planned"
            missing[reference] = Failure("MismatchedEtag", why)
    return worlds, missing


@functools.lru_cache(maxsize=_WORLDS_KEPT)
def _world(store_url: str, reference: str, digest: str) -> World:
    """Returns a world; the last ones are kept, since chunks that follow one another share theirs."""
    return decode_world(pinned_world_bytes(open_store(store_url), reference, digest))
