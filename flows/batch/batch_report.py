"""A batch's report: collects the facts from the store's records, and writes the page beside the tables.

A report is written when the batch ends, when the gate has judged it, and when its run has ended and the times of the
stages are known. Each report replaces the one before. It is made from records and tables alone, so that `simyard
report` makes the same bytes. A report decides nothing: a batch ends, is judged and is shipped without it, and its
record then says that the report is missing.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

from pydantic import JsonValue

from flows.batch.recorded_episodes import BAGS_FOLDER
from specs.data.run_report import PipelineReport
from specs.errors import ResourceNotFound, SimyardError
from tasks.results.report.facts import BatchFacts, Link, StageTime
from tasks.results.report.judgement import read_judgement
from tasks.results.report.page import report_page
from tasks.results.report.report_job import batch_view, put_report
from tasks.results.report.view import ReportView
from tasks.results.tables.recordings import RECORDINGS_FOLDER
from tasks.simulate.batch.job import KIND, plan_of
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.keys import trend_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, job_id, read
from tasks.storage.jobs.runs import stage_token
from tasks.storage.store_url import store_id

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
        seeds=len(plan.seeds),
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
        audit=cast("dict[str, JsonValue] | None", detail.get("audit")),
        stages=_stages(run),
        links=_links(record, beside_tables=beside_tables),
        trend=_trend(record, run, beside_tables=beside_tables),
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
