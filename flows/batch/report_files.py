"""`simyard report`: finds the batch, and writes its page to a file or beside the batch's tables."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from flows.batch.batch_end import close_if_stopped
from flows.batch.batch_report import has_tables, report_view_of
from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import DocumentError
from tasks.results.report.page import report_page
from tasks.results.report.report_job import REPORT_FILE, put_report
from tasks.simulate.batch.job import KIND, load_batch
from tasks.simulate.batch.seal import unvouched_notice
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, job_id

_RUN = "run-"
"""What the ids of runs begin with, and those of batches do not."""


@dataclass(frozen=True)
class ReportPage:
    """A page that was written: where it is, its bytes, and what to tell who reads it; empty if nothing."""

    url: str
    page: bytes
    notice: str = ""


def write_report_page(store: Store, text: str, output: Path | None) -> ReportPage:
    """Writes the report of the batch that is named, to a file or beside the batch's tables.

    Args:
        store: The store of the batch.
        text: ARN or id of a batch, ARN of one of its jobs, or of a run of a document.
        output: The file, or None for ``report.html`` beside the tables.

    Raises:
        ResourceNotFound: The store has no such batch.
        DocumentError: The text names no batch, or one that has no tables.
    """
    record = ended_batch(store, batch_named(text), text)
    page = report_page(report_view_of(store, record, beside_tables=output is None))
    notice = unvouched_notice(load_batch(store, record.id))
    if output is None:
        return ReportPage(put_report(store, recorded_location(record), record.id, page), page, notice)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(page)
    return ReportPage(output.resolve().as_uri(), page, notice)


def local_copy(place: ReportPage) -> Path:
    """Returns a file with the page that a browser on this machine can open; of one in a folder, that one."""
    parts = urlsplit(place.url)
    if parts.scheme == "file":
        return Path(url2pathname(parts.path))
    path = Path(tempfile.mkdtemp(prefix="simyard-report-")) / REPORT_FILE
    path.write_bytes(place.page)
    return path


def ended_batch(store: Store, batch: str, text: str) -> JobRecord:
    """Returns the record of a batch that has ended and has its tables.

    Args:
        store: The store of the batch.
        batch: Its id.
        text: How it was named.

    Raises:
        ResourceNotFound: The store has no such batch.
        DocumentError: It has no tables, or not yet.
    """
    record = close_if_stopped(store, batch)
    if has_tables(record):
        return record
    why = record.failure_reason or "its tables come when it ends"
    raise _refused(text, f"a batch with tables; this one is {record.status}: {why}")


def batch_named(text: str) -> str:
    """Returns the id of the batch that an ARN or an id of it, of one of its jobs, or of a run of a document means.

    Raises:
        DocumentError: It means something else.
    """
    try:
        reference = parse_reference(text)
    except ValueError as exc:
        raise _refused(text, str(exc)) from exc
    if reference.kind == "pipeline-run" or (reference.kind is None and reference.path.startswith(_RUN)):
        return job_id(KIND, f"{reference.path}-batch")
    if reference.kind not in {None, KIND, "simulation-job"}:
        raise _refused(text, f"an ARN of a {KIND}, of one of its jobs, or of a pipeline-run")
    return reference.path.partition("/")[0]


def _refused(text: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(text), allowed=allowed)], source="simyard")
