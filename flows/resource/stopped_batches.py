"""Batches that were stopped and that nobody works on: closed before anybody is told of them."""

import logging

from specs.errors import StoreError
from tasks.simulate.batch.job import KIND as BATCH
from tasks.simulate.batch.job import STOPPING
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.under_way import records_under_way
from tasks.storage.jobs.records import read

logger = logging.getLogger(__name__)


def close_stopped_batch(store: Store, path: str) -> str:
    """Closes a batch that was stopped and abandoned; returns its path, ``<batch>`` or ``<batch>/<index>``, unchanged.

    A batch that cannot be closed now, because its output bucket is gone, stays as it is, and a warning says so.
    """
    batch = path.partition("/")[0]
    if read(store, BATCH, batch).status in STOPPING:
        from flows.batch.batch_end import close_if_stopped  # noqa: PLC0415 - it imports MuJoCo and Arrow, which describing does not need

        try:
            close_if_stopped(store, batch)
        except StoreError as exc:
            logger.warning("batch %s was stopped and cannot be closed: %s", batch, exc)
    return path


def close_stopped_batches(store: Store) -> Store:
    """Closes every batch that was stopped and abandoned; returns the store."""
    for record in records_under_way(store, BATCH):
        close_stopped_batch(store, record.id)
    return store
