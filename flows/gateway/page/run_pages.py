"""The pages of runs of documents, of batches and of their simulation jobs.

What Prefect's pages show is linked and not copied.
"""

import functools
import re
from collections.abc import Mapping

from pydantic import JsonValue, ValidationError

from flows.gateway.page.files import has_report, report_address, trend_address
from flows.gateway.page.request_context import (
    PAGE_ROWS,
    RequestContext,
    address,
    job,
    known_job,
    known_jobs,
    missing,
    named,
    newest_jobs,
    number,
    state,
    step_of,
    tag_rows,
    when,
)
from flows.resources.run_lists import verdict_of
from specs.arn import ResourceKind
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.data.run_report import PipelineReport
from specs.job_kinds import JOB_KINDS
from tasks.gateway.page.content import Block, Cell, Facts, Page, Table
from tasks.simulate.batch.batch_jobs import describe_job
from tasks.simulate.batch.batch_record import KIND, OpenBatch, canceled_jobs, load_batch, plan_of
from tasks.simulate.batch.chunk_store import chunk_numbers, committed_chunk
from tasks.simulate.plan.plan_batch import policy_and_tags
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, document_of_run, jobs_of, run_of
from tasks.storage.jobs.runs import KIND as RUN

_FLOW_RUN = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
_TRAIL = (("Batches", "/batches"),)
_VARIABLES = 120


def runs_table(context: RequestContext, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the newest runs; with an address for all of them, no more than the first."""
    shown, steps = step_of(context, newest_jobs(context, RUN), "/runs", most)
    rows = tuple(_run_row(context, record) for record in known_jobs(context, RUN, shown))
    columns = ("Run", "Document", "Status", "Verdict", "Changed", "What it came to")
    empty = "No run yet: simyard run DOCUMENT begins one."
    return Table("Runs of documents", columns, rows, empty, href if steps else "", None if href else steps)


def runs_page(context: RequestContext) -> Page:
    """Returns the list of runs."""
    return Page("Runs of documents", blocks=(runs_table(context),))


def run_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a run.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no run's.
    """
    record = job(context, RUN, name)
    report, document = _run_report(record), document_of_run(record)
    links = [("On the Prefect server", url)] if (url := _prefect(context, record)) else []
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
        context.plain(record.failure_reason),
        (("Runs", "/runs"),),
        tuple(links),
        (_stages(context, record, report), Facts("The run", tuple(row for row in rows if row))),
        is_going=not is_terminal(record),
    )


def _run_row(context: RequestContext, record: JobRecord) -> tuple[Cell, ...]:
    report = _run_report(record)
    said = report.stages[-1].summary if report and report.stages else record.failure_reason
    return (
        Cell(record.id, address(RUN, record.id)),
        Cell(document_of_run(record)),
        state(record.status),
        state(report.verdict or "" if report else ""),
        when(record.updated_at_s),
        Cell(context.plain(said)),
    )


def _stages(context: RequestContext, record: JobRecord, report: PipelineReport | None) -> Table:
    if report is None:
        return _run_jobs(context, record)
    rows = tuple(
        (
            Cell(stage.name),
            state(stage.status),
            named(stage.arn),
            Cell(context.plain(stage.summary)),
            Cell(f"{stage.seconds:,.1f} s", is_number=True),
        )
        for stage in report.stages
    )
    return Table("Stages", ("Stage", "Status", "Job", "What it came to", "Took"), rows)


def _run_jobs(context: RequestContext, record: JobRecord) -> Table:
    """Returns the jobs of a run that has no report: those that it has begun, and those that it may begin."""
    rows: list[tuple[Cell, ...]] = []
    for kind, name in jobs_of(record):
        found = known_job(context.store, kind, name) if context.may_read(context.arn(kind, name)) else None
        link = Cell(name, address(kind, name)) if found else Cell()
        status = state(found.status) if found else Cell("not begun")
        why = Cell(context.plain(found.failure_reason) if found else "")
        rows.append((Cell(JOB_KINDS[kind].section or kind), status, link, why))
    return Table("Stages", ("Stage", "Status", "Job", "Why not"), tuple(rows), "It has no job of its own.")


def _run_report(record: JobRecord) -> PipelineReport | None:
    try:
        return PipelineReport.model_validate(record.detail["report"]) if "report" in record.detail else None
    except ValidationError:  # not what Simyard has written
        return None


def _prefect(context: RequestContext, record: JobRecord) -> str:
    found = str(record.detail.get(FLOW_RUN) or record.detail.get(FLOW_RUN_BEFORE) or "")
    pages = context.prefect_url() if _FLOW_RUN.fullmatch(found) else ""
    return f"{pages}/runs/flow-run/{found}" if pages else ""


def batches_table(context: RequestContext, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the newest batches; with an address for all of them, no more than the first."""
    names = newest_jobs(context, KIND)
    shown, steps = step_of(context, names, "/batches", most)
    rows = tuple(_batch_row(context, record) for record in known_jobs(context, KIND, shown))
    columns = ("Batch", "Status", "Verdict", "Passed", "Document", "Changed", "Report")
    empty = "No batch yet: simyard run, or StartSimulationJobBatch, makes one."
    return Table("Batches", columns, rows, empty, href if steps else "", None if href else steps)


def batches_page(context: RequestContext) -> Page:
    """Returns the list of batches."""
    return Page("Batches", blocks=(batches_table(context),))


def batch_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a batch.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no batch's.
    """
    record = job(context, KIND, name)
    run = _run(context, record)
    document = document_of_run(run) if run else ""
    links = [("Report", report_address(record))] if has_report(record) else []
    if trend := trend_address(document):
        links.append((f"Night by night: {document}", trend))
    why = tuple(
        (
            Cell(str(each.get("reason", ""))),
            number(_count(each, "episodes")),
            Cell(context.plain(str(each.get("sample", "")))),
        )
        for each in _mappings(record.detail.get("why_not"))
    )
    blocks: list[Block] = [_facts(context, record, run), _jobs_table(context, record)]
    if why:
        blocks.insert(1, Table("Why episodes did not pass", ("Reason", "Episodes", "The first message"), why))
    return Page(
        name,
        "Simulation job batch",
        record.status,
        context.plain(record.failure_reason),
        _TRAIL,
        tuple(links),
        tuple(blocks),
        is_going=not is_terminal(record),
    )


def job_page(context: RequestContext, batch: str, index: str) -> Page:
    """Returns the page of a simulation job.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    path = f"{batch}/{index}"
    record = job(context, KIND, batch)
    context.require("simulation-job", path)
    if not (index.isascii() and index.isdecimal() and len(index) < 10 and str(int(index)) == index):
        raise missing("simulation-job", path)
    described = describe_job(context.store, path)
    opened = load_batch(context.store, batch)
    asked, row = opened.layout.request(int(index)), _Results(opened).of(int(index))
    known = row is not None and described.status in {"Completed", "Failed", "Canceled", "RunningFailed"}
    return Page(
        f"{batch}-{index}",
        "Simulation job",
        described.status or "",
        context.plain(described.failureReason or ""),
        (*_TRAIL, (batch, address(KIND, batch))),
        blocks=(
            Facts("What came of it", _result_rows(row) if row and known else (("Result", Cell("none yet")),)),
            Facts(
                "What was asked for",
                (
                    *_asked_rows(batch, asked),
                    *context.arn_rows(context.arn("simulation-job", path)),
                    *tag_rows(context, "simulation-job", path, described.tags),
                ),
            ),
        ),
        is_going=not is_terminal(record),
    )


def _batch_row(context: RequestContext, record: JobRecord) -> tuple[Cell, ...]:
    run = _run(context, record)
    passed, asked = record.detail.get("passed"), record.detail.get("episodes")
    report = Cell("report", report_address(record)) if has_report(record) else Cell()
    return (
        Cell(record.id, address(KIND, record.id)),
        state(record.status),
        state(_verdict(run)),
        Cell(f"{passed} of {asked}" if passed is not None and asked else ""),
        Cell(document_of_run(run), address(RUN, run.id)) if run else Cell(),
        when(record.updated_at_s),
        report,
    )


def _facts(context: RequestContext, record: JobRecord, run: JobRecord | None) -> Facts:
    detail, plan = record.detail, plan_of(record)
    policy, tags = policy_and_tags(record)
    metadata = detail.get("metadata")
    engine = metadata.get("engine") if isinstance(metadata, dict) else plan.engine
    passed, asked = detail.get("passed"), detail.get("episodes")
    robots = dict.fromkeys(template.robot for template in plan.templates)
    scenarios = dict.fromkeys(template.scenario for template in plan.templates)
    rows = [
        ("verdict", state(_verdict(run))) if _verdict(run) else None,
        ("passed", Cell(f"{passed} of {asked} episodes")) if passed is not None and asked else None,
        ("run", Cell(run.id, address(RUN, run.id), document_of_run(run))) if run else None,
        ("begun", when(record.created_at_s)),
        ("changed", when(record.updated_at_s)),
        ("failure code", Cell(record.failure_code)) if record.failure_code else None,
        *(("robot application", _application(each.name, each.version, "robot-application")) for each in robots),
        *(
            ("simulation application", _application(each.name, each.version, "simulation-application"))
            for each in scenarios
        ),
        ("worlds", Cell(f"{len({*plan.worlds, *(world for each in plan.templates for world in each.worlds)}):,}")),
        ("engine", Cell(str(engine))),
        ("report", Cell(context.plain(str(detail["report_failed"])))) if "report_failed" in detail else None,
        ("batch policy", Cell(f"at most {policy.maxConcurrency} at once"))
        if policy and policy.maxConcurrency
        else None,
        *context.arn_rows(record.arn),
        *tag_rows(context, KIND, record.id, tags),
    ]
    return Facts("The batch", tuple(row for row in rows if row))


def _application(name: str, version: str, kind: ResourceKind) -> Cell:
    return Cell(f"{name} {version}", address(kind, name))


class _Results:
    """The results of a batch's episodes, a chunk read once."""

    def __init__(self, batch: OpenBatch) -> None:
        self._batch = batch
        self.chunks = chunk_numbers(batch.store, batch.id)
        self._read = functools.lru_cache(maxsize=PAGE_ROWS)(self._chunk)

    def of(self, index: int) -> EpisodeResult | None:
        """Returns what came of an episode; None for nothing yet."""
        return self._read(self._batch.layout.chunk_of(index)).get(index)

    def status(self, index: int, *, ended: bool) -> str:
        """Returns how it is with an episode that has no result."""
        begun = self._batch.layout.chunk_of(index) in self.chunks.begun
        return "Running" if begun and not ended else "Canceled" if ended else "Pending"

    def _chunk(self, number: int) -> Mapping[int, EpisodeResult]:
        if number not in self.chunks.committed:
            return {}
        return {row.index: row for row in committed_chunk(self._batch.store, self._batch.id, number) or ()}


def _jobs_table(context: RequestContext, record: JobRecord) -> Table:
    batch = load_batch(context.store, record.id)
    results, ended, canceled = _Results(batch), is_terminal(record), canceled_jobs(record)
    shown, steps = step_of(context, range(batch.layout.episodes), address(KIND, record.id))
    rows: list[tuple[Cell, ...]] = []
    for index in shown:
        row, asked = results.of(index), batch.layout.request(index)
        status = row.status if row else "Canceled" if index in canceled else results.status(index, ended=ended)
        rows.append(_job_row(record.id, asked, row, status))
    columns = ("Job", "Status", "Outcome", "World", "Seed", "Variables", "Simulated")
    return Table("Simulation jobs", columns, tuple(rows), "None yet.", steps=steps)


def _job_row(batch: str, asked: EpisodeRequest, row: EpisodeResult | None, status: str) -> tuple[Cell, ...]:
    variables = ", ".join(f"{name}={value}" for name, value in sorted(asked.environment.items()))
    return (
        Cell(str(asked.index), address("simulation-job", f"{batch}/{asked.index}")),
        state(status),
        _outcome(row),
        Cell(asked.world, address("world", asked.world)),
        number(asked.seed),
        Cell(variables if len(variables) <= _VARIABLES else f"{variables[:_VARIABLES]}…"),
        number(row.simulated_s, "s", 1) if row else Cell(is_number=True),
    )


def _outcome(row: EpisodeResult | None) -> Cell:
    if row is None or success(row) is None:
        return Cell()
    return Cell("Passed" if success(row) else "Failed", small=reason(row), is_state=True)


def _result_rows(row: EpisodeResult) -> tuple[tuple[str, Cell], ...]:
    shortest = row.shortest_path_m
    rows = (
        ("outcome", _outcome(row)),
        ("failure code", Cell(row.failure_code)) if row.failure_code else None,
        ("goals reached", Cell(f"{row.goals_reached} of {row.goals_total}")),
        ("simulated", _plain(row.simulated_s, "s")),
        ("path", _plain(row.path_length_m, "m")),
        ("shortest path", _plain(shortest, "m")) if shortest else None,
        ("collisions", Cell(str(row.collisions))),
        ("least distance to a solid", _plain(row.min_clearance_m, "m")),
        ("energy", _plain(row.energy_j, "J")),
        ("rooms entered", Cell(", ".join(row.rooms_entered), small=f"of {row.rooms_total}"))
        if row.rooms_total
        else None,
        ("engine", Cell(f"{row.engine} on {row.device}")) if row.engine else None,
        *((name, Cell(f"{value:g}")) for name, value in sorted(row.metrics.items())),
    )
    return tuple(each for each in rows if each)


def _plain(value: float, unit: str) -> Cell:
    return Cell(f"{value:,.2f} {unit}")


def _asked_rows(batch: str, asked: EpisodeRequest) -> tuple[tuple[str, Cell], ...]:
    return (
        ("world", Cell(asked.world, address("world", asked.world))),
        ("seed", Cell(str(asked.seed))),
        ("robot application", _application(asked.robot.name, asked.robot.version, "robot-application")),
        ("simulation application", _application(asked.scenario.name, asked.scenario.version, "simulation-application")),
        ("simulated seconds at most", Cell(f"{asked.duration_s:g}")),
        *((f"variable {name}", Cell(value)) for name, value in sorted(asked.environment.items())),
        ("see it again", Cell(f"simyard replay {batch}/{asked.index}", is_code=True)),
    )


def _run(context: RequestContext, record: JobRecord) -> JobRecord | None:
    """Returns the run that a batch belongs to, if it may be seen."""
    name = run_of(record.token)
    return known_job(context.store, RUN, name) if name and context.may_read(context.arn(RUN, name)) else None


def _verdict(run: JobRecord | None) -> str:
    try:
        return verdict_of(run) or ""
    except ValidationError:  # a report that Simyard has not written
        return ""


def _mappings(given: JsonValue) -> list[dict[str, JsonValue]]:
    return [each for each in given if isinstance(each, dict)] if isinstance(given, list) else []


def _count(given: Mapping[str, JsonValue], name: str) -> int | None:
    found = given.get(name)
    return found if isinstance(found, int) else None
