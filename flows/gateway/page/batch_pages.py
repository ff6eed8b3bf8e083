"""The pages of batches and of their simulation jobs."""

import functools
from collections.abc import Mapping

from pydantic import JsonValue, ValidationError

from flows.gateway.page.files import has_report, report_address, trend_address
from flows.gateway.page.stored import PAGE_ROWS, job, known_job, known_jobs, newest_jobs, step_of
from flows.gateway.page.visit import Visit, address, missing, number, state, tag_rows, when
from flows.resource.batch_columns import verdict_of
from specs.arn import ResourceKind
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from tasks.gateway.page.content import Block, Cell, Facts, Page, Table
from tasks.simulate.batch.chunk_store import chunk_numbers, committed_chunk
from tasks.simulate.batch.describe import describe_job
from tasks.simulate.batch.job import KIND, OpenBatch, canceled_jobs, load_batch, plan_of
from tasks.simulate.plan.request import policy_and_tags
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import run_document, run_of

_TRAIL = (("Batches", "/batches"),)
_VARIABLES = 120


def batches_table(visit: Visit, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the newest batches; with an address for all of them, no more than the first."""
    names = newest_jobs(visit, KIND)
    shown, steps = step_of(visit, names, "/batches", most)
    rows = tuple(_batch_row(visit, record) for record in known_jobs(visit, KIND, shown))
    columns = ("Batch", "Status", "Verdict", "Passed", "Document", "Changed", "Report")
    empty = "No batch yet: simyard run, or StartSimulationJobBatch, makes one."
    return Table("Batches", columns, rows, empty, href if steps else "", None if href else steps)


def batches_page(visit: Visit) -> Page:
    """Returns the list of batches."""
    return Page("Batches", blocks=(batches_table(visit),))


def batch_page(visit: Visit, name: str) -> Page:
    """Returns the page of a batch.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no batch's.
    """
    record = job(visit, KIND, name)
    run = _run(visit, record)
    document = run_document(run) if run else ""
    links = [("Report", report_address(record))] if has_report(record) else []
    if trend := trend_address(document):
        links.append((f"Night by night: {document}", trend))
    why = tuple(
        (
            Cell(str(each.get("reason", ""))),
            number(_count(each, "episodes")),
            Cell(visit.plain(str(each.get("sample", "")))),
        )
        for each in _mappings(record.detail.get("why_not"))
    )
    blocks: list[Block] = [_facts(visit, record, run), _jobs_table(visit, record)]
    if why:
        blocks.insert(1, Table("Why episodes did not pass", ("Reason", "Episodes", "The first message"), why))
    return Page(
        name,
        "Simulation job batch",
        record.status,
        visit.plain(record.failure_reason),
        _TRAIL,
        tuple(links),
        tuple(blocks),
        is_going=not is_terminal(record),
    )


def job_page(visit: Visit, batch: str, index: str) -> Page:
    """Returns the page of a simulation job.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    path = f"{batch}/{index}"
    record = job(visit, KIND, batch)
    visit.require("simulation-job", path)
    if not (index.isascii() and index.isdecimal() and len(index) < 10 and str(int(index)) == index):
        raise missing("simulation-job", path)
    described = describe_job(visit.store, path)
    opened = load_batch(visit.store, batch)
    asked, row = opened.layout.request(int(index)), _Results(opened).of(int(index))
    known = row is not None and described.status in {"Completed", "Failed", "Canceled", "RunningFailed"}
    return Page(
        f"{batch}-{index}",
        "Simulation job",
        described.status or "",
        visit.plain(described.failureReason or ""),
        (*_TRAIL, (batch, address(KIND, batch))),
        blocks=(
            Facts("What came of it", _result_rows(row) if row and known else (("Result", Cell("none yet")),)),
            Facts(
                "What was asked for",
                (
                    *_asked_rows(batch, asked),
                    *visit.arn_rows(visit.arn("simulation-job", path)),
                    *tag_rows(visit, "simulation-job", path, described.tags),
                ),
            ),
        ),
        is_going=not is_terminal(record),
    )


def _batch_row(visit: Visit, record: JobRecord) -> tuple[Cell, ...]:
    run = _run(visit, record)
    passed, asked = record.detail.get("passed"), record.detail.get("episodes")
    report = Cell("report", report_address(record)) if has_report(record) else Cell()
    return (
        Cell(record.id, address(KIND, record.id)),
        state(record.status),
        state(_verdict(run)),
        Cell(f"{passed} of {asked}" if passed is not None and asked else ""),
        Cell(run_document(run), address(RUN, run.id)) if run else Cell(),
        when(record.updated_at_s),
        report,
    )


def _facts(visit: Visit, record: JobRecord, run: JobRecord | None) -> Facts:
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
        ("run", Cell(run.id, address(RUN, run.id), run_document(run))) if run else None,
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
        ("report", Cell(visit.plain(str(detail["report_failed"])))) if "report_failed" in detail else None,
        ("batch policy", Cell(f"at most {policy.maxConcurrency} at once"))
        if policy and policy.maxConcurrency
        else None,
        *visit.arn_rows(record.arn),
        *tag_rows(visit, KIND, record.id, tags),
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


def _jobs_table(visit: Visit, record: JobRecord) -> Table:
    batch = load_batch(visit.store, record.id)
    results, ended, canceled = _Results(batch), is_terminal(record), canceled_jobs(record)
    shown, steps = step_of(visit, range(batch.layout.episodes), address(KIND, record.id))
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


def _run(visit: Visit, record: JobRecord) -> JobRecord | None:
    """Returns the run that a batch belongs to, if it may be seen."""
    name = run_of(record.token)
    return known_job(visit.store, RUN, name) if name and visit.may_read(visit.arn(RUN, name)) else None


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
