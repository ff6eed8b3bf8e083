"""The whole report of a run: what its records say, however it ended."""

from collections.abc import Callable, Iterator
from pathlib import Path
from shlex import quote
from typing import cast, get_args

from pydantic import ValidationError

from flows.ci.run_files import AskedRun
from flows.stage.stage_summary import batch_report, deployment_report, export_report, generation_report
from specs.arn import arn, resource_kind, resource_name, store_id_of
from specs.data.run_report import PipelineReport, StageName, StageReport
from specs.errors import (
    DocumentError,
    ObjectNotFound,
    PipelineNotPassed,
    ResourceNotFound,
    SimyardError,
    StageFailed,
)
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.results.ci.full_report import Answer, CountedBatch, FullReport, GateReport, RunFailure
from tasks.results.ci.groups import FAILURE_COLUMNS, RESULT_COLUMNS, GroupRules, count_groups
from tasks.results.gate.evidence import Evidence, read_evidence
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE
from tasks.results.tables.stored_rows import stored_rows
from tasks.simulate.batch.job import KIND
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import jobs_of, run_of
from tasks.storage.store_url import open_existing_store

_CONFIDENCE = 0.95


def report_of_run(asked: AskedRun, report: PipelineReport, exit_code: int) -> FullReport:
    """Returns the whole report of a run that came to its end, passed or not.

    Args:
        asked: The run.
        report: What each stage did.
        exit_code: What the command ends with.
    """
    answer: Answer = "PASSED" if report.passed else "INCONCLUSIVE" if report.undecided else "NOT PASSED"
    found = FullReport(
        answer=answer,
        exit_code=exit_code,
        document=report.name,
        store=asked.store_url,
        run=report.run,
        verdict=report.verdict,
        shipped=report.shipped,
        stages=report.stages,
    )
    return _with_batch(asked, found)


def report_of_failure(asked: AskedRun, failure: Exception, exit_code: int) -> FullReport:
    """Returns the whole report of a run that has no end of its own: a stage failed, or the document was refused.

    Args:
        asked: The run.
        failure: Why.
        exit_code: What the command ends with.
    """
    if isinstance(failure, PipelineNotPassed):
        return report_of_run(asked, failure.report, exit_code)
    refused = isinstance(failure, DocumentError)
    found = FullReport(
        answer="REFUSED" if refused else "FAILED",
        exit_code=exit_code,
        document=asked.document,
        store=asked.store_url,
        failure=_failure(failure),
    )
    if not isinstance(failure, StageFailed) or not failure.arn:
        return found
    return _tried(found, lambda: _with_stages(asked, found, failure.arn))


def batch_counts(store: Store, record: JobRecord, evidence: Evidence | None) -> CountedBatch:
    """Returns a batch that has its tables in groups of episodes.

    Args:
        store: Where it is.
        record: Its record.
        evidence: What a gate said of it; None if none was asked.

    Raises:
        ResourceNotFound: Its tables are gone.
        StageFailed: They are not what it wrote.
    """
    place, digests = recorded_location(record), record.detail["sha256s"]
    written = digests if isinstance(digests, dict) else {}
    results, failures = (
        stored_rows(store, place, record.id, name, sha256=str(written.get(name, "")), columns=columns)
        for name, columns in ((RESULTS_FILE, RESULT_COLUMNS), (FAILURES_FILE, FAILURE_COLUMNS))
    )
    rate = evidence.rule.successRate if evidence else None
    baseline = evidence.baseline if evidence else None
    rules = GroupRules(
        verdict=evidence.verdict if evidence else None,
        bar=rate.atLeast if rate else None,
        confidence=rate.confidence if rate else _CONFIDENCE,
        compared_with=(baseline.digest,) if baseline and baseline.batch == record.id else (),
        job_arn=arn("simulation-job", store_id_of(record.arn), ""),
        store_option=store_option(store.url),
    )
    return count_groups(record.arn, results, failures, rules)


def gate_report_of(evidence: Evidence) -> GateReport:
    """Returns what the gate answered, as its evidence says it."""
    return GateReport(verdict=evidence.verdict, sentence=evidence.sentence, rules=evidence.rules)


def store_option(url: str) -> str:
    """Returns what a command needs to find a store: nothing for ``.simyard`` in the working directory."""
    return "" if url == Path(".simyard").resolve().as_uri() else f"--store {quote(url)}"


def _failure(failure: Exception) -> RunFailure:
    if isinstance(failure, DocumentError):
        reason = f"{failure.source} has faults"
        return RunFailure(code=type(failure).__name__, reason=reason, faults=failure.faults)
    if isinstance(failure, StageFailed):
        kind = _job_kind(failure.arn)
        return RunFailure(
            stage=_section(kind) if kind else None, code=failure.code, reason=failure.reason, arn=failure.arn
        )
    if isinstance(failure, SimyardError):
        return RunFailure(code=type(failure).__name__, reason=str(failure))
    return RunFailure(code=type(failure).__name__, reason=f"this is a defect of Simyard: {failure}")


def _with_stages(asked: AskedRun, found: FullReport, failed: str) -> FullReport:
    """Returns the report with the stages of the run that ended before one failed, as their records say."""
    store = open_existing_store(asked.store_url)
    run_id = _run_id(store, failed)
    if not run_id:
        return found
    run = read(store, "pipeline-run", run_id)
    stages = tuple(_ended_stages(store, run))
    return _with_batch(asked, found.model_copy(update={"run": run.id, "stages": stages}))


def _run_id(store: Store, failed: str) -> str:
    kind, name = _job_kind(failed), resource_name(failed)
    if kind == "pipeline-run":
        return name
    return run_of(read(store, kind, name).token) if kind else ""


def _job_kind(text: str) -> JobKind | None:
    """Returns the kind of the job that an ARN names; None if it names something else, or nothing."""
    found = resource_kind(text) if text else None
    return next((kind for kind in get_args(JobKind) if kind == found), None)


def _section(kind: JobKind) -> StageName | None:
    """Returns the section of a document that asks for such jobs; None for the run itself."""
    return cast("StageName", JOB_KINDS[kind].section) if JOB_KINDS[kind].section else None


def _ended_stages(store: Store, run: JobRecord) -> Iterator[StageReport]:
    for kind, job in jobs_of(run):
        try:
            record = read(store, kind, job)
        except ResourceNotFound:
            continue
        section = _section(kind)
        if is_terminal(record) and section:
            yield _stage(store, record, section)


def _stage(store: Store, record: JobRecord, section: StageName) -> StageReport:
    seconds = record.updated_at_s - record.created_at_s
    if record.status not in {"Completed", "Succeeded", "PartialFailed"}:
        summary = f"{record.failure_code}: {record.failure_reason}"
        return StageReport(name=section, arn=record.arn, status=record.status, summary=summary, seconds=seconds)
    if record.kind == "world-generation-job":
        return generation_report(record, store, seconds)
    told = {"world-export-job": export_report, "simulation-job-batch": batch_report}
    return told.get(record.kind, deployment_report)(record, seconds)


def _with_batch(asked: AskedRun, found: FullReport) -> FullReport:
    """Returns the report with its batch and its gate, if it came so far."""
    batches = [stage.arn for stage in found.stages if stage.name == "simulationBatch" and stage.arn]
    return _tried(found, lambda: _counted(asked, found, batches[0])) if batches else found


def _counted(asked: AskedRun, found: FullReport, batch: str) -> FullReport:
    store = open_existing_store(asked.store_url)
    record = read(store, KIND, resource_name(batch))
    evidence = _evidence(store, record.id) if found.verdict else None
    gate = gate_report_of(evidence) if evidence else None
    counts = batch_counts(store, record, evidence) if "results_url" in record.detail else None
    return found.model_copy(update={"gate": gate, "batch": counts})


def _evidence(store: Store, batch: str) -> Evidence | None:
    try:
        return read_evidence(store, batch)
    except ObjectNotFound:
        return None


def _tried(found: FullReport, more: Callable[[], FullReport]) -> FullReport:
    """Returns a report with more in it, or with why that could not be found out: a report changes no answer."""
    try:
        return more()
    except (SimyardError, ValidationError) as exc:
        why = " ".join(str(exc).split())
        return found.model_copy(update={"problems": (*found.problems, f"not all could be read: {why}")})
