"""Prefect artifacts of a run: a table of its stages, its batch's speed, and a short form of the batch's report."""

import base64

from prefect.artifacts import create_image_artifact, create_markdown_artifact, create_table_artifact

from flows.batch.batch_report import WrittenReport
from specs import artifact_text
from specs.artifact_text import table_rows
from specs.data.run_report import PipelineReport
from tasks.progress.document import artifact_key
from tasks.results.report.page import report_markdown, report_picture
from tasks.simulate.batch.metrics import metric_rows, recorded_metrics
from tasks.storage.jobs.records import JobRecord


def show_metrics(record: JobRecord) -> None:
    """Leaves a batch's figures as the artifact ``batch-metrics`` of the run of its flow."""
    metrics = recorded_metrics(record)
    if metrics:
        rows = table_rows(dict(row) for row in metric_rows(metrics))
        create_table_artifact(table=rows, key=artifact_key("batch-metrics"), description=f"Speed of {record.id}")


def show_batch_report(reported: WrittenReport) -> None:
    """Leaves a report, in short, as the artifacts ``batch-report`` and ``batch-picture`` of the run of the flow."""
    view, batch = reported.view, reported.view.facts.batch
    text = report_markdown(view, reported.url)
    create_markdown_artifact(text, key=artifact_key("batch-report"), description=f"Report of {batch}")
    picture = base64.b64encode(report_picture(view)).decode()
    create_image_artifact(
        f"data:image/svg+xml;base64,{picture}",
        key=artifact_key("batch-picture"),
        description=f"Rate and failures of {batch}",
    )


def show_run_report(report: PipelineReport) -> None:
    """Leaves what each stage came to as the artifact ``pipeline-report``."""
    rows = [
        {"stage": s.name, "status": s.status, "what came of it": s.summary, "seconds": round(s.seconds, 1)}
        for s in report.stages
    ]
    key = artifact_text.artifact_key(report.name, "pipeline-report")  # this is after the block of the document's run
    create_table_artifact(table=table_rows(rows), key=key, description=f"{report.name}: {report.run}")
