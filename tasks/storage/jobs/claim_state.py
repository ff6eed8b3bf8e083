"""The state of a claim: whether somebody works on a job, found out without taking its claim."""

import time
from collections.abc import Callable

from specs.errors import ObjectConflict, ObjectNotFound
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.jobs.holder import is_known_dead


class ClaimWatch:
    """Looks at a claim again and again; its holder is gone when nobody has renewed it for the time it is good for.

    Args:
        store: Where the claim lies.
        key: See ``tasks.storage.base.keys.claim_key``.
        now_s: A clock that never goes back.
    """

    def __init__(self, store: Store, key: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._key = key
        self._now_s = now_s
        self._seen = ""
        self._found: ClaimRecord | None = None
        self._since_s = 0.0
        self._writes = 0

    @property
    def renewed(self) -> bool:
        """Whether somebody was seen to write it: its holder lives, or another one took it."""
        return self._writes > 1

    def is_left(self) -> bool:
        """Returns whether nobody works on it as far as can be told from what was seen until now."""
        try:
            stored = self._store.get(self._key)
        except ObjectNotFound:
            self._found = None
            return True
        if stored.etag != self._seen:
            self._seen, self._since_s = stored.etag, self._now_s()
            self._writes += 1
        found = self._found = decode_document(ClaimRecord, stored, self._store, self._key)
        return found.released or self._now_s() - self._since_s >= found.ttl_s or is_known_dead(found.process)

    def release(self) -> bool:
        """Returns whether the claim is free now, having released it on behalf of a holder that left it.

        Only exactly what was seen is written over, so that a holder which renews it at the same moment keeps it; one
        that was paused takes it back when it wakes up, and is first, or finds itself replaced.
        """
        if self._found is None or self._found.released:
            return True
        try:
            body = encode_document(self._found.model_copy(update={"released": True}))
            self._seen = self._store.replace(self._key, body, self._seen)
        except (ObjectConflict, ObjectNotFound):
            return False
        return True
