"""Whether somebody works on a job, found out by looking, without taking its claim."""

import time
from collections.abc import Callable

from specs.errors import ObjectNotFound
from tasks.storage.claim import ClaimRecord
from tasks.storage.encoding import decoded
from tasks.storage.process import is_known_dead
from tasks.storage.store import Store


class ClaimWatch:
    """Looks at a claim again and again; its holder is gone when nobody has renewed it for the time it is good for.

    Args:
        store: Where the claim lies.
        key: See ``tasks.storage.keys.claim_key``.
        now_s: A clock that never goes back.
    """

    def __init__(self, store: Store, key: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._key = key
        self._now_s = now_s
        self._seen = ""
        self._since_s = 0.0

    def is_left(self) -> bool:
        """Returns whether nobody works on it as far as can be told from what was seen until now."""
        try:
            stored = self._store.get(self._key)
        except ObjectNotFound:
            return True
        if stored.etag != self._seen:
            self._seen, self._since_s = stored.etag, self._now_s()
        found = decoded(ClaimRecord, stored, self._store, self._key)
        return found.released or self._now_s() - self._since_s >= found.ttl_s or is_known_dead(found.process)
