"""Claims of holders that live: renewed again and again, and left to them however busy the machine is."""

from collections.abc import Generator
from contextlib import contextmanager

import pytest

from tasks.storage.base.store import Store
from tasks.storage.jobs import claim as claims
from tasks.storage.jobs.claim import Claim, hold_claim

LIVELY_S = 600.0
_BEAT_S = 0.05


def renew_often(patched: pytest.MonkeyPatch) -> None:
    """Has claims that are good for ``LIVELY_S`` renewed often enough that nobody waits long for a sign of life."""
    patched.setattr(claims, "_BEATS", LIVELY_S / _BEAT_S)


@contextmanager
def hold_lively_claim(store: Store, key: str) -> Generator[Claim]:
    """Holds a claim as a process does that works: it is renewed twenty times a second, and good for ten minutes."""
    with pytest.MonkeyPatch.context() as patched:
        renew_often(patched)
        with hold_claim(store, key, ttl_s=LIVELY_S) as claim:
            yield claim
