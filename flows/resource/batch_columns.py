"""What a person wants to see of a batch in a list and RoboMaker's summary has no field for."""

from collections.abc import Mapping

from pydantic import JsonValue

from specs.data.run_report import PipelineReport, Verdict
from tasks.simulate.batch.job import KIND
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, records
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of, run_document

Columns = Mapping[str, JsonValue]


def batch_columns(store: Store) -> dict[str, Columns]:
    """Returns for each batch, by its ARN, the document, the gate's verdict, and how many of its episodes passed."""
    runs = {job: run for run in records(store, RUN) for kind, job in jobs_of(run) if kind == KIND}
    return {batch.arn: _columns(batch, runs.get(batch.id)) for batch in records(store, KIND)}


def verdict_of(run: JobRecord | None) -> Verdict | None:
    """Returns the verdict of a run's gate; None where it has none, or none yet."""
    report = run.detail.get("report") if run else None
    return PipelineReport.model_validate(report).verdict if report else None


def why_not(run: JobRecord) -> str | None:
    """Returns why a run failed: what stopped it, else what the stage says that was not passed; None for no failure."""
    if run.failure_reason or "report" not in run.detail:
        return run.failure_reason or None
    report = PipelineReport.model_validate(run.detail["report"])
    if report.passed:
        return None
    return (
        f"{report.stages[-1].status}: {report.stages[-1].summary}"
        if report.verdict in (None, "PASS")
        else _gate(report)
    )


def _gate(report: PipelineReport) -> str:
    said = next((stage.summary for stage in report.stages if stage.name == "gate"), "")
    return f"{report.verdict}: {said}"


def _columns(batch: JobRecord, run: JobRecord | None) -> Columns:
    passed, asked = batch.detail.get("passed"), batch.detail.get("episodes")
    found = {
        "document": run_document(run) if run else None,
        "verdict": verdict_of(run),
        "passed": f"{passed}/{asked}" if passed is not None and asked else None,
    }
    return {name: value for name, value in found.items() if value}
