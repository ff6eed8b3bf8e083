"""How a batch ends: its tables, audit and report are written, and its record is closed.

The batch's flow ends it. If a batch was stopped while no process worked on it, the next command that reads it ends it.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, cast

from pydantic import JsonValue

from flows.batch.batch_report import MissingReport, WrittenReport, report_fields, write_last_report
from flows.batch.recorded_episodes import bags_url, bags_written
from specs.field_types import OutputLocation
from tasks.results.tables.recordings import recordings_url
from tasks.results.tables.table_record import write_batch_tables
from tasks.simulate.batch.job import KIND, STOPPING, OpenBatch, close_batch, load_batch, terminal_state
from tasks.simulate.batch.provenance import batch_metadata, seal
from tasks.simulate.batch.result_stream import give_up, result_parts
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord


def close_if_stopped(store: Store, batch: str) -> JobRecord:
    """Returns a batch's record; a batch that is being stopped, and that no process works on, is closed first.

    Its tables have the rows of the episodes that were driven, and Canceled rows for the rest. If a process works on it,
    or may (a process on another machine has 15 s to show that it lives), the record is returned as it stands.

    Raises:
        ResourceNotFound: No such batch.
    """
    work = load_batch(store, batch)
    record = work.record()
    if record.status not in STOPPING:
        return record
    with hold_claim_unless_alive(store, claim_key(KIND, batch)) as claim:
        record = work.record()
        if claim is None or record.status not in STOPPING:
            return record
        give_up(work)
        return close_with_tables(work)


def close_with_tables(batch: OpenBatch, audit: Callable[[], Mapping[str, JsonValue]] = dict) -> JobRecord:
    """Returns a batch in its terminal state, its tables being written; every chunk that was begun is committed."""
    record = batch.record()
    return end_batch(batch, record, recorded_location(record), write_tables=_write_tables, audit=audit).record


class BatchEnd(NamedTuple):
    """A batch that was closed: its record in its terminal state, and its report."""

    record: JobRecord
    report: WrittenReport | MissingReport


def end_batch(
    batch: OpenBatch,
    record: JobRecord,
    location: OutputLocation,
    *,
    write_tables: Callable[[OpenBatch, OutputLocation, str], Mapping[str, JsonValue]],
    audit: Callable[[], Mapping[str, JsonValue]] = dict,
    more: Mapping[str, JsonValue] | None = None,
) -> BatchEnd:
    """Writes a batch's tables, audit and report, and closes it; every chunk that was begun is committed.

    Args:
        batch: The batch.
        record: As it stood when its last episode ended.
        location: Where tables and report go.
        write_tables: Writes the tables of a batch with that status; returns what the record says of them.
        audit: Audits a batch that is Completed; returns what the record says of that, nothing if there is no audit.
        more: What the record says besides, such as why the batch ended early.
    """
    detail = {**write_tables(batch, location, record.status), **(more or {})}
    if batch.plan.records():
        detail["recordings_url"] = recordings_url(batch.store.url, location, batch.id)
    if bags_written(batch):
        detail["bags_url"] = bags_url(batch, location)
    status, why = terminal_state(record, cast("int", detail["failed_inside"]))
    if status == "Completed":
        detail = with_audit(detail, audit())
        detail |= seal(batch, detail)
    report = write_last_report(batch.store, record, status, detail, why)
    return BatchEnd(close_batch(batch.store, batch.id, status, detail | report_fields(report), why), report)


def with_audit(detail: Mapping[str, JsonValue], audited: Mapping[str, JsonValue]) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its tables and of its audit, whose file is one of the batch's, too.

    Args:
        detail: Of the tables, with the SHA-256 of each by its name.
        audited: Of the audit, likewise; empty if there was none.
    """
    tables, audit = (cast("dict[str, JsonValue]", each.get("sha256s", {})) for each in (detail, audited))
    return {**detail, **audited, "sha256s": {**tables, **audit}}


def _write_tables(batch: OpenBatch, location: OutputLocation, status: str) -> dict[str, JsonValue]:
    return write_batch_tables(
        batch.store,
        batch.id,
        result_parts(batch, status),
        variables=batch.plan.variables(),
        location=location,
        metadata=batch_metadata(batch.plan.lanes),
    )[0]
