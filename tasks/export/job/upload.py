"""Uploads files to a bucket over a network that fails now and then."""

import logging
import random
import time
from collections.abc import Callable
from pathlib import Path

from specs.errors import BucketNotFound, StoreDamaged, StoreError, StoreUnreachable
from tasks.storage.base.store import Store

_WAITS_S = (1.0, 3.0, 9.0)
_log = logging.getLogger(__name__)


def upload(bucket: Store, key: str, source: Path) -> None:
    """Uploads a file whose key nobody else writes; tries again while the bucket does not answer or damages it.

    What earlier uploads of the key have left is swept away first: parts that nobody sees are paid for.

    Raises:
        StoreError: What went wrong the last time.
    """
    _sweep(bucket, key)
    _patiently(lambda: bucket.upload(key, source))


def put(bucket: Store, key: str, body: bytes) -> None:
    """Writes a small object; tries again while the bucket does not answer.

    Raises:
        StoreError: What went wrong the last time.
    """
    _patiently(lambda: bucket.put(key, body))


def _patiently(write: Callable[[], object]) -> None:
    for wait_s in _WAITS_S:
        try:
            write()
        except BucketNotFound:
            raise
        except (StoreDamaged, StoreUnreachable) as exc:
            # Spread, so that a hundred exports that failed together do not come back together.
            spread_s = wait_s * random.SystemRandom().uniform(0.5, 1.5)
            _log.warning("%s; trying again in %.1f s", exc, spread_s)
            time.sleep(spread_s)
        else:
            return
    write()


def _sweep(bucket: Store, key: str) -> None:
    try:
        bucket.sweep(key)
    except StoreError as exc:
        # To list unfinished uploads is a permission of its own, and not every server can; whether one may write is
        # told by writing.
        _log.warning("what broken uploads have left stays: %s", exc)
