"""Lists of runs and batches: pages of runs, and the columns that RoboMaker's summary of a batch lacks."""

import functools
from collections.abc import Iterable, Iterator, Mapping

from pydantic import JsonValue

from specs.arn import resource_name
from specs.data.run_report import ListPipelineRunsRequest, ListPipelineRunsResponse, PipelineReport, RunSummary, Verdict
from specs.errors import ResourceNotFound
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import IndexEntry, all_entries, index_page, place_of
from tasks.storage.jobs.records import JobRecord, read, records
from tasks.storage.jobs.runs import KIND, document_of_run, jobs_of, run_of
from tasks.storage.jobs.runs import KIND as RUN

Columns = Mapping[str, JsonValue]


def batch_columns(store: Store, batches: Iterable[str]) -> dict[str, Columns]:
    """Returns for batches, by their ARNs, the document, the gate's verdict, and how many of its episodes passed."""
    runs = _Runs(store)
    found = ((arn, _read_batch(store, resource_name(arn))) for arn in batches)
    return {arn: _columns(batch, runs.of(batch)) for arn, batch in found if batch}


class _Runs:
    """The runs that batches belong to; all are read only for a batch whose document brought a token of its own."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read = functools.cache(self._one)

    def of(self, batch: JobRecord) -> JobRecord | None:
        """Returns the run of a batch, or None."""
        run = run_of(batch.token)
        return self._read(run) if run else self._by_job.get(batch.id)

    @functools.cached_property
    def _by_job(self) -> dict[str, JobRecord]:
        return {job: run for run in records(self._store, RUN) for kind, job in jobs_of(run) if kind == BATCH}

    def _one(self, run: str) -> JobRecord | None:
        try:
            return read(self._store, RUN, run)
        except ResourceNotFound:
            return None


def _read_batch(store: Store, batch: str) -> JobRecord | None:
    try:
        return read(store, BATCH, batch)
    except ResourceNotFound:  # removed since it was listed
        return None


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
        "document": document_of_run(run) if run else None,
        "verdict": verdict_of(run),
        "passed": f"{passed}/{asked}" if passed is not None and asked else None,
    }
    return {name: value for name, value in found.items() if value}


_MOST = 1000


def run_entry(_store: Store, run: JobRecord) -> IndexEntry:
    """Returns the index entry of a run."""
    spec = run.request.get("spec", {})
    summary = RunSummary(
        arn=run.arn,
        name=str(spec.get("name", run.request.get("flow"))) if isinstance(spec, dict) else run.id,
        status=run.status,
        createdAt=run.created_at_s,
        verdict=verdict_of(run),
        failureReason=why_not(run),
    )
    values = {"status": (summary.status,), "name": (summary.name,), "verdict": (summary.verdict or "",)}
    return IndexEntry(
        place_of(run.created_at_s, run.id), values, summary.model_dump(mode="json", exclude_none=True), {}
    )


def list_runs(store: Store) -> Iterator[RunSummary]:
    """Yields all runs."""
    return (RunSummary.model_validate(entry.summary) for entry in all_entries(store, KIND, run_entry))


def list_runs_page(store: Store, request: ListPipelineRunsRequest) -> ListPipelineRunsResponse:
    """Returns one page of the runs; filters are ``status``, ``name``, the document's, and ``verdict``.

    Raises:
        DocumentError: The token, the size or a filter is none that the list takes.
    """
    filters = {name: name for name in ("status", "name", "verdict")}
    found, token = index_page(store, KIND, run_entry, request, most=_MOST, filters=filters)
    summaries = tuple(RunSummary.model_validate(each) for each in found)
    return ListPipelineRunsResponse(runSummaries=summaries, nextToken=token)
