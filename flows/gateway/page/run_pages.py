"""The pages of runs of documents, with what Prefect's pages show linked and not copied."""

import re

from pydantic import ValidationError

from flows.gateway.page.files import trend_address
from flows.gateway.page.stored import PAGE_ROWS, job, known_job, known_jobs, newest_jobs, step_of
from flows.gateway.page.visit import Visit, address, named, state, when
from specs.data.run_report import PipelineReport
from specs.job_kinds import JOB_KINDS
from tasks.gateway.page.content import Cell, Facts, Page, Table
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, jobs_of, run_document
from tasks.storage.jobs.runs import KIND as RUN

_FLOW_RUN = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def runs_table(visit: Visit, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the newest runs; with an address for all of them, no more than the first."""
    shown, steps = step_of(visit, newest_jobs(visit, RUN), "/runs", most)
    rows = tuple(_row(visit, record) for record in known_jobs(visit, RUN, shown))
    columns = ("Run", "Document", "Status", "Verdict", "Changed", "What it came to")
    empty = "No run yet: simyard run DOCUMENT begins one."
    return Table("Runs of documents", columns, rows, empty, href if steps else "", None if href else steps)


def runs_page(visit: Visit) -> Page:
    """Returns the list of runs."""
    return Page("Runs of documents", blocks=(runs_table(visit),))


def run_page(visit: Visit, name: str) -> Page:
    """Returns the page of a run.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no run's.
    """
    record = job(visit, RUN, name)
    report, document = _report(record), run_document(record)
    links = [("On the Prefect server", url)] if (url := _prefect(visit, record)) else []
    tests = (
        any(kind == "simulation-job-batch" for kind, _ in jobs_of(record)) and record.request.get("flow") == "pipeline"
    )
    if tests and (trend := trend_address(document)):
        links.append(("Night by night", trend))
    rows = [
        ("id", Cell(record.id)),
        ("verdict", state(report.verdict)) if report and report.verdict else None,
        ("shipped", Cell("yes" if report.shipped else "no")) if report and report.shipped is not None else None,
        ("begun", when(record.created_at_s)),
        ("changed", when(record.updated_at_s)),
        ("failure code", Cell(record.failure_code)) if record.failure_code else None,
        ("ARN", Cell(record.arn, is_code=True)),
    ]
    return Page(
        document,
        "Run of a document",
        record.status,
        visit.plain(record.failure_reason),
        (("Runs", "/runs"),),
        tuple(links),
        (_stages(visit, record, report), Facts("The run", tuple(row for row in rows if row))),
        is_going=not is_terminal(record),
    )


def _row(visit: Visit, record: JobRecord) -> tuple[Cell, ...]:
    report = _report(record)
    said = report.stages[-1].summary if report and report.stages else record.failure_reason
    return (
        Cell(record.id, address(RUN, record.id)),
        Cell(run_document(record)),
        state(record.status),
        state(report.verdict or "" if report else ""),
        when(record.updated_at_s),
        Cell(visit.plain(said)),
    )


def _stages(visit: Visit, record: JobRecord, report: PipelineReport | None) -> Table:
    if report is None:
        return _jobs(visit, record)
    rows = tuple(
        (
            Cell(stage.name),
            state(stage.status),
            named(stage.arn),
            Cell(visit.plain(stage.summary)),
            Cell(f"{stage.seconds:,.1f} s", is_number=True),
        )
        for stage in report.stages
    )
    return Table("Stages", ("Stage", "Status", "Job", "What it came to", "Took"), rows)


def _jobs(visit: Visit, record: JobRecord) -> Table:
    """Returns the jobs of a run that has no report: those that it has begun, and those that it may begin."""
    rows: list[tuple[Cell, ...]] = []
    for kind, name in jobs_of(record):
        found = known_job(visit.store, kind, name) if visit.may_read(visit.arn(kind, name)) else None
        link = Cell(name, address(kind, name)) if found else Cell()
        status = state(found.status) if found else Cell("not begun")
        why = Cell(visit.plain(found.failure_reason) if found else "")
        rows.append((Cell(JOB_KINDS[kind].section or kind), status, link, why))
    return Table("Stages", ("Stage", "Status", "Job", "Why not"), tuple(rows), "It has no job of its own.")


def _report(record: JobRecord) -> PipelineReport | None:
    try:
        return PipelineReport.model_validate(record.detail["report"]) if "report" in record.detail else None
    except ValidationError:  # not what Simyard has written
        return None


def _prefect(visit: Visit, record: JobRecord) -> str:
    found = str(record.detail.get(FLOW_RUN) or record.detail.get(FLOW_RUN_BEFORE) or "")
    pages = visit.prefect_url() if _FLOW_RUN.fullmatch(found) else ""
    return f"{pages}/runs/flow-run/{found}" if pages else ""
