"""How fast a batch was: in its record, and on its flow's page."""

from prefect.artifacts import create_table_artifact
from pydantic import JsonValue

from tasks.simulate.metrics import METRICS, BatchMetrics, metric_rows, recorded_metrics
from tasks.storage.records import JobRecord


def noted_metrics(metrics: BatchMetrics | None) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its speed; nothing if nothing was simulated."""
    return {METRICS: metrics.model_dump(mode="json")} if metrics else {}


def show_metrics(record: JobRecord) -> None:
    """Leaves a batch's figures as the artifact ``batch-metrics`` of the run of its flow."""
    metrics = recorded_metrics(record)
    if metrics:
        rows = [dict(row) for row in metric_rows(metrics)]
        create_table_artifact(table=rows, key="batch-metrics", description=f"Speed of {record.id}")
