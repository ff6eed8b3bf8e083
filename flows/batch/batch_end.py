"""A batch that was stopped while no process worked on it, closed by whoever asks about it."""

from collections.abc import Mapping
from typing import cast

from pydantic import JsonValue

from flows.batch.batch_report import noted, write_last_report
from tasks.results.tables.recordings import recordings_url
from tasks.results.tables.table_record import write_batch_tables
from tasks.simulate.batch.job import KIND, STOPPING, OpenBatch, close_batch, ending, opened
from tasks.simulate.batch.provenance import batch_metadata
from tasks.simulate.batch.result_stream import give_up, parts
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import claimed_unless_alive
from tasks.storage.jobs.records import JobRecord


def settled(store: Store, batch: str) -> JobRecord:
    """Returns a batch's record; one that is being stopped and that nobody works on is closed first.

    Its tables have the rows of what was done, and Canceled ones for the rest. Where somebody works on it, or may
    (a process on another machine is given 15 s to show that it lives), the record is returned as it stands.

    Raises:
        ResourceNotFound: No such batch.
    """
    work = opened(store, batch)
    record = work.record()
    if record.status not in STOPPING:
        return record
    with claimed_unless_alive(store, claim_key(KIND, batch)) as claim:
        record = work.record()
        if claim is None or record.status not in STOPPING:
            return record
        give_up(work)
        return close_with_tables(work)


def close_with_tables(batch: OpenBatch) -> JobRecord:
    """Returns a batch in its terminal state, its tables being written; every chunk that was begun is committed."""
    record = batch.record()
    location = recorded_location(record)
    detail, _ = write_batch_tables(
        batch.store,
        batch.id,
        parts(batch),
        variables=batch.plan.variables(),
        location=location,
        metadata=batch_metadata(batch.plan.lanes),
    )
    if batch.plan.records():
        detail["recordings_url"] = recordings_url(batch.store.url, location, batch.id)
    status, why = ending(record, cast("int", detail["failed_inside"]))
    detail |= noted(write_last_report(batch.store, record, status, detail, why))
    return close_batch(batch.store, batch.id, status, detail, why)


def with_audit(detail: Mapping[str, JsonValue], audited: Mapping[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its tables and of its audit, whose file is one of the batch's, too.

    Args:
        detail: Of the tables, with the SHA-256 of each by its name.
        audited: Of the audit, likewise; empty if there was none.
    """
    tables, audit = (cast("dict[str, JsonValue]", each.get("sha256s", {})) for each in (detail, audited))
    return {**detail, **audited, "sha256s": {**tables, **audit}}
