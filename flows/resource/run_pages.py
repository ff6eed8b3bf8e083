"""Pages of the runs of documents, oldest first."""

from collections.abc import Iterator

from flows.resource.batch_columns import verdict_of, why_not
from specs.data.run_report import ListPipelineRunsRequest, ListPipelineRunsResponse, RunSummary
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.line_page import all_lines, line_page
from tasks.storage.jobs.lines.marks import mark_of
from tasks.storage.jobs.lines.segments import Line
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.runs import KIND

_MOST = 1000


def run_line(_store: Store, run: JobRecord) -> Line:
    """Returns the line of a run."""
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
    return Line(mark_of(run.created_at_s, run.id), values, summary.model_dump(mode="json", exclude_none=True), {})


def list_runs(store: Store) -> Iterator[RunSummary]:
    """Yields all runs."""
    return (RunSummary.model_validate(line.summary) for line in all_lines(store, KIND, run_line))


def list_runs_page(store: Store, request: ListPipelineRunsRequest) -> ListPipelineRunsResponse:
    """Returns one page of the runs; filters are ``status``, ``name``, the document's, and ``verdict``.

    Raises:
        DocumentError: The token, the size or a filter is none that the list takes.
    """
    filters = {name: name for name in ("status", "name", "verdict")}
    found, token = line_page(store, KIND, run_line, request, most=_MOST, filters=filters)
    summaries = tuple(RunSummary.model_validate(each) for each in found)
    return ListPipelineRunsResponse(runSummaries=summaries, nextToken=token)
