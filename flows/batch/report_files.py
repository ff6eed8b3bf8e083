"""`simyard report`: finds the batch, and writes its page to a file or beside the batch's tables."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from flows.batch.batch_end import close_if_stopped
from flows.batch.batch_report import has_tables, report_view_of
from specs.base import Fault
from specs.errors import DocumentError
from tasks.results.report.page import report_page
from tasks.results.report.report_job import REPORT_FILE, put_report
from tasks.results.report.view import ReportView
from tasks.simulate.batch.job import load_batch
from tasks.simulate.batch.provenance import unvouched_notice
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.resource_names import find_batch_name


@dataclass(frozen=True)
class ReportPage:
    """A page that was written: where it is, its bytes, what it shows, and what to tell who reads it, if anything."""

    url: str
    page: bytes
    view: ReportView
    notice: str = ""


def write_report_page(store: Store, text: str, output: Path | None) -> ReportPage:
    """Writes the report of the batch that is named, to a file or beside the batch's tables.

    Args:
        store: The store of the batch.
        text: ARN or id of a batch, of one of its jobs, or of a run of a document.
        output: The file, or None for ``report.html`` beside the tables.

    Raises:
        ResourceNotFound: The store has no such batch.
        DocumentError: The text names no batch, or one that has no tables.
    """
    record = ended_batch(store, text)
    view = report_view_of(store, record, beside_tables=output is None)
    page = report_page(view)
    notice = unvouched_notice(load_batch(store, record.id))
    if output is None:
        return ReportPage(put_report(store, recorded_location(record), record.id, page), page, view, notice)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(page)
    return ReportPage(output.resolve().as_uri(), page, view, notice)


def local_copy(place: ReportPage) -> Path:
    """Returns a file with the page that a browser on this machine can open; of one in a folder, that one."""
    parts = urlsplit(place.url)
    if parts.scheme == "file":
        return Path(url2pathname(parts.path))
    path = Path(tempfile.mkdtemp(prefix="simyard-report-")) / REPORT_FILE
    path.write_bytes(place.page)
    return path


def ended_batch(store: Store, text: str) -> JobRecord:
    """Returns the record of a batch that has ended and has its tables.

    Args:
        store: The store of the batch.
        text: ARN or id of it, of one of its jobs, or of a run of a document.

    Raises:
        ResourceNotFound: The store has no such batch.
        DocumentError: The text names no batch, or one that has no tables.
    """
    record = close_if_stopped(store, find_batch_name(store, text))
    if has_tables(record):
        return record
    why = record.failure_reason or "its tables come when it ends"
    raise _refused(text, f"a batch with tables; this one is {record.status}: {why}")


def _refused(text: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(text), allowed=allowed)], source="simyard")
