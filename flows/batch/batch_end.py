"""How a batch ends: recordings, bags, tables, audit and report are written, and its record is closed.

The batch's flow ends it. If a batch was stopped while no process worked on it, the next command that reads it ends it.
Recorded episodes leave samples in Parquet, and bags for ROS's tools, made of the same samples, if they are asked for.

A report is written when the batch ends, when the gate has judged it, and when its run has ended and the times of the
stages are known. Each report replaces the one before. It is made from records and tables alone, so that `simyard
report` makes the same bytes. A report decides nothing: a batch ends, is judged and is shipped without it, and its
record then says that the report is missing.
"""

import logging
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, cast
from urllib.parse import urlsplit
from urllib.request import url2pathname

from pydantic import JsonValue

from specs.data.parity_audit import audit_report
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, ResourceNotFound, SimyardError
from specs.field_types import OutputLocation
from tasks.results.playback.replay_formats import is_installed, require_bag_writers
from tasks.results.report.batch_facts import BatchFacts, Link, StageTime, read_judgement
from tasks.results.report.report_page import REPORT_FILE, batch_view, put_report, report_page
from tasks.results.report.report_view import ReportView
from tasks.results.statistics.batch_summary import EpisodeTally
from tasks.results.statistics.found_failures import read_search
from tasks.results.tables.recordings import RECORDINGS_FOLDER, recordings_url, write_recordings
from tasks.results.tables.result_files import write_batch_tables
from tasks.simulate.batch.batch_record import (
    KIND,
    STOPPING,
    OpenBatch,
    close_batch,
    load_batch,
    plan_of,
    terminal_state,
)
from tasks.simulate.batch.chunk_run import load_worlds
from tasks.simulate.batch.provenance import batch_metadata, seal, unvouched_notice
from tasks.simulate.batch.result_stream import give_up, result_parts
from tasks.simulate.lane.recording import Columns
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.simulate.replay.recorded_pictures import with_pictures
from tasks.storage.base.keys import checked_name, claim_key, output_key, trend_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, is_terminal, job_id, read
from tasks.storage.jobs.runs import stage_token
from tasks.storage.resource_names import find_batch_name
from tasks.storage.store_url import store_id

BAGS_FOLDER = "bags"


# Parquet is the record; a bag is made of the same samples.
class RecordedEpisodes:
    """Writes what recorded episodes leave, before the chunk that names them is committed."""

    def __init__(self, batch: OpenBatch, location: OutputLocation, folders: Mapping[str, Path]) -> None:
        """Begins with a batch, its output location, and the unpacked folders of its applications by digest."""
        self._batch, self._location, self._folders = batch, location, folders
        self._written: dict[int, set[str]] = {}

    def write(self, chunk: int, parts: Iterable[Columns]) -> str:
        """Returns the name of the file of a chunk's recordings; empty if there are none.

        Called again for a chunk, it writes over what it wrote, and removes the bags of who was cancelled meanwhile.

        Raises:
            DocumentError: Bags are asked for, and nothing here can write them.
        """
        before, now = self._written.get(chunk, set[str]()), set[str]()
        pictures = self._batch.plan.recordings.picturesHz is not None
        seen = (with_pictures(self._batch, part, self._folders) for part in parts) if pictures else parts
        kept = self._with_bags(seen, now) if bags_written(self._batch) else seen
        where = (self._batch.store.url, self._location, self._batch.id, chunk)
        name = write_recordings(*where, kept, pictures=pictures)
        for key in sorted(before - now):
            self._bucket().delete(key)
        self._written[chunk] = now
        return name

    def _with_bags(self, parts: Iterable[Columns], written: set[str]) -> Iterator[Columns]:
        """Yields the parts as they are, having written the bags of their episodes; notes the keys."""
        for part in parts:
            written.update(self._write_bags(part))
            yield part

    def _write_bags(self, samples: Columns) -> Iterator[str]:
        from tasks.results.playback.ros_log import RosView, sample_logs  # noqa: PLC0415 - an extra
        from tasks.ros.bag.bag_file import write_bags  # noqa: PLC0415
        from tasks.simulate.host.twist_drive import robot_view  # noqa: PLC0415 - it loads MuJoCo

        bucket, plan, layout = self._bucket(), self._batch.plan, self._batch.layout
        requests = {index: layout.request(index) for index in dict.fromkeys(samples["index"].tolist())}
        worlds, _ = load_worlds(self._batch, requests.values())
        views = {
            index: RosView(worlds[request.world], *robot_view(self._folders[request.robot.digest]))
            for index, request in requests.items()
        }
        for index, log in sample_logs(views, samples):
            formats = plan.bags_of(plan.templates[layout.template_of(index)])
            with tempfile.TemporaryDirectory(prefix="simyard-bags-") as folder:
                for path in write_bags(Path(folder), f"{index:06d}", log, formats):
                    key = f"{self._folder()}/{path.relative_to(folder).as_posix()}"
                    bucket.upload(key, path)
                    yield key

    def _bucket(self) -> Store:
        return open_bucket(self._batch.store, self._location.s3Bucket or "")

    def _folder(self) -> str:
        return _bags_folder(self._batch, self._location)


def bags_written(batch: OpenBatch) -> bool:
    """Returns whether a batch's recorded episodes leave bags on this machine.

    A request of before that asks to record all topics does not fail for want of an extra; a document that asks for bags
    does.

    Raises:
        DocumentError: They are asked for, and nothing here can write them.
    """
    if not batch.plan.makes_bags():
        return False
    require_bag_writers(batch.plan.recordings.bags)
    return is_installed("ros")


def bags_url(batch: OpenBatch, location: OutputLocation) -> str:
    """Returns where a batch's bags lie."""
    return f"{open_bucket(batch.store, location.s3Bucket or '').url}/{_bags_folder(batch, location)}"


def _bags_folder(batch: OpenBatch, location: OutputLocation) -> str:
    return output_key(location.s3Prefix, f"{BAGS_FOLDER}/{checked_name(batch.id, 'batch')}")


logger = logging.getLogger(__name__)
_STAGE = "-batch"
_TABLES = ("results", "failures", "audit")


@dataclass(frozen=True)
class WrittenReport:
    """A report that was written: where it is, and what it shows."""

    url: str
    view: ReportView


@dataclass(frozen=True)
class MissingReport:
    """There is no report, and why, for a person."""

    why: str

    def alarm(self) -> str:
        """Returns the alarm about it."""
        return f"There is no new report: {self.why}"


def write_report(store: Store, record: JobRecord) -> WrittenReport | MissingReport:
    """Writes the report of a batch beside its tables, over the one before.

    Args:
        store: The store of the batch.
        record: The batch's record, with its tables.
    """

    def write() -> WrittenReport:
        view = report_view_of(store, record)
        return WrittenReport(put_report(store, recorded_location(record), record.id, report_page(view)), view)

    return try_report(write)


def try_report(write: Callable[[], WrittenReport]) -> WrittenReport | MissingReport:
    """Returns a report that was written, or why it could not be.

    A defect in a page must not keep a batch from its end, nor a version that passed from its robots. The records and
    the terminal name the defect, and `simyard report` fails with it.
    """
    try:
        return write()
    except SimyardError as exc:
        logger.warning("no report was written: %s", exc)
        return MissingReport(" ".join(str(exc).split()))
    except Exception as exc:
        logger.exception("no report was written")
        return MissingReport(f"this is a defect of Simyard: {' '.join(f'{type(exc).__name__}: {exc}'.split())}")


def write_last_report(
    store: Store, record: JobRecord, status: str, detail: Mapping[str, JsonValue], why: str
) -> WrittenReport | MissingReport:
    """Writes the report of a batch that is about to be closed.

    The report is written before the record is closed, so that a closed batch always has its report; `report_fields`
    returns what the record says of it.

    Args:
        store: The store of the batch.
        record: As it stands.
        status: What it will be; ``detail`` and ``why`` likewise.
        detail: What its record will have besides.
        why: Its failure reason, or empty.
    """
    closed = {"status": status, "failure_reason": why, "detail": {**record.detail, **detail}}
    return write_report(store, record.model_copy(update=closed))


def report_fields(written: WrittenReport | MissingReport) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its report: ``report_url``, or ``report_failed`` and why."""
    return {"report_url": written.url} if isinstance(written, WrittenReport) else {"report_failed": written.why}


def write_report_of_run(store: Store, run: JobRecord) -> WrittenReport | MissingReport | None:
    """Writes the report of a run's batch once more; None if it has none with tables."""
    batch = job_id(KIND, stage_token(run, "batch"))
    try:
        record = read(store, KIND, batch)
    except ResourceNotFound:
        return None
    return write_report(store, record) if has_tables(record) else None


def has_tables(record: JobRecord) -> bool:
    """Returns whether a batch's tables are written, so that it can be reported on."""
    return is_terminal(record) and "results_url" in record.detail


def report_view_of(store: Store, record: JobRecord, *, beside_tables: bool = True) -> ReportView:
    """Returns what the report of a batch shows.

    Args:
        store: The store of the batch.
        record: The batch's record, with its tables.
        beside_tables: Whether the page will lie beside the tables, so that links to them are relative.
    """
    facts = batch_facts(store, record, beside_tables=beside_tables)
    return batch_view(store, facts, recorded_location(record))


def batch_facts(store: Store, record: JobRecord, *, beside_tables: bool) -> BatchFacts:
    """Returns what the store's records say of a batch."""
    plan, detail, run = plan_of(record), record.detail, _run(store, record)
    return BatchFacts(
        batch=record.id,
        arn=record.arn,
        store=store_id(store),
        name=_document_name(run),
        status=record.status,
        why=record.failure_reason,
        created_at_s=record.created_at_s,
        simulated_s=cast("float", detail["simulated_s"]),
        seeds=len(plan.seeds_used()),
        worlds={
            world: plan.world_digests.get(world, "")
            for template in plan.templates
            for world in plan.worlds_of(template)
        },
        variables=plan.variables(),
        robots=tuple(dict.fromkeys(template.robot for template in plan.templates)),
        simulations=tuple(dict.fromkeys(template.scenario for template in plan.templates)),
        metadata=cast("dict[str, str]", detail["metadata"]),
        judgement=read_judgement(store, record.id),
        audit=audit_report(detail),
        search=read_search(store, record.id),
        looks=len(Layout(plan).looks()),
        stages=_stages(run),
        links=_links(record, beside_tables=beside_tables),
        trend=_trend(record, run, beside_tables=beside_tables),
        pictures=plan.recordings.picturesHz is not None,
    )


def _trend(record: JobRecord, run: JobRecord | None, *, beside_tables: bool) -> str:
    """Returns the link to the trend, which lies beside the batch's folder; empty for a batch of no document's run."""
    document = _document_name(run)
    if not document:
        return ""
    folder = str(record.detail["results_url"]).rpartition(f"/{record.id}/")[0]
    return f"{'..' if beside_tables else folder}/{trend_key(document)}"


def _links(record: JobRecord, *, beside_tables: bool) -> tuple[Link, ...]:
    detail = record.detail
    digests = cast("dict[str, str]", detail["sha256s"])
    urls = [str(detail[f"{name}_url"]) for name in _TABLES if f"{name}_url" in detail]
    links = [
        Link(label=name, href=name if beside_tables else url, sha256=digests.get(name, ""))
        for url, name in ((url, url.rpartition("/")[2]) for url in urls)
    ]
    if "recordings_url" in detail:
        near = f"../{RECORDINGS_FOLDER}/{record.id}/"
        links.append(Link(label="recordings", href=near if beside_tables else str(detail["recordings_url"])))
    if "bags_url" in detail:
        near = f"../{BAGS_FOLDER}/{record.id}/"
        links.append(Link(label="bags", href=near if beside_tables else str(detail["bags_url"])))
    return tuple(links)


def _run(store: Store, record: JobRecord) -> JobRecord | None:
    """Returns the run of the document that the batch was a stage of, or None."""
    if not record.token.endswith(_STAGE):
        return None
    try:
        return read(store, "pipeline-run", record.token.removesuffix(_STAGE))
    except ResourceNotFound:
        return None


def _document_name(run: JobRecord | None) -> str:
    spec = run.request.get("spec") if run else None
    return str(spec.get("name", "")) if isinstance(spec, dict) else ""


def _stages(run: JobRecord | None) -> tuple[StageTime, ...]:
    report = run.detail.get("report") if run else None
    if report is None:
        return ()
    stages = PipelineReport.model_validate(report).stages
    return tuple(
        StageTime(name=stage.name, seconds=stage.seconds, summary=stage.summary) for stage in stages if stage.seconds
    )


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
    location = recorded_location(record)
    tables, _ = write_tables_of(batch, location, record.status)
    return end_batch(batch, record, location, tables, audit).record


class BatchEnd(NamedTuple):
    """A batch that was closed: its record in its terminal state, and its report."""

    record: JobRecord
    report: WrittenReport | MissingReport


def end_batch(
    batch: OpenBatch,
    record: JobRecord,
    location: OutputLocation,
    tables: Mapping[str, JsonValue],
    audit: Callable[[], Mapping[str, JsonValue]] = dict,
) -> BatchEnd:
    """Writes a batch's audit and report, and closes it; its tables are written.

    Args:
        batch: The batch.
        record: As it stood when its last episode ended.
        location: Where tables and report go.
        tables: What its record says of its tables, and besides, such as why the batch ended early.
        audit: Audits a batch that is Completed; returns what the record says of that, nothing if there is no audit.
    """
    detail = {**tables}
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


def write_tables_of(
    batch: OpenBatch, location: OutputLocation, status: str
) -> tuple[dict[str, JsonValue], EpisodeTally]:
    """Writes the tables of a batch that ends with a status; returns what its record says of them, and their tally."""
    return write_batch_tables(
        batch.store,
        batch.id,
        result_parts(batch, status),
        variables=batch.plan.variables(),
        location=location,
        metadata=batch_metadata(batch.plan.lanes),
    )


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
    return DocumentError.of("arn", repr(text), allowed, source="simyard")
