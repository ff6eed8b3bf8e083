"""Reads a batch's table as it was written."""

from collections.abc import Sequence
from typing import cast

import pyarrow as pa

from specs.base import Fault
from specs.errors import DocumentError
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE
from tasks.results.tables.stored_rows import stored_rows
from tasks.simulate.batch.job import KIND, load_batch
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_batch_name


def batch_rows(store: Store, batch: str, columns: Sequence[str] | None, *, failures: bool) -> tuple[str, pa.Table]:
    """Returns a batch's id and its rows.

    Args:
        store: The store of the batch.
        batch: ARN or id of the batch, of one of its jobs, or of a run of a document.
        columns: Names of columns; None for all.
        failures: Whether to read the table of those that did not pass.

    Raises:
        ResourceNotFound: There is no such batch, or its tables are gone.
        DocumentError: It has no tables yet, or no such column.
        StageFailed: They are not what it wrote.
    """
    record = load_batch(store, find_batch_name(store, batch)).record()
    if "results_url" not in record.detail:
        raise _refused(KIND, record.id, f"a batch that has its tables; this one is {record.status}")
    name = FAILURES_FILE if failures else RESULTS_FILE
    written = cast("dict[str, str]", record.detail["sha256s"])[name]
    table = stored_rows(store, recorded_location(record), record.id, name, sha256=written)
    unknown = [each for each in columns or () if each not in table.column_names]
    if unknown:
        raise _refused("columns", ", ".join(unknown), f"columns of {name}: {', '.join(table.column_names)}")
    return record.id, table.select(list(columns)) if columns else table


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=value, allowed=allowed)], "simyard")
