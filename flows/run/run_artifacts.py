"""The Prefect artifact of a whole run: a table of its stages."""

from prefect.artifacts import create_table_artifact

from specs.artifact_text import artifact_key, table_rows
from specs.data.run_report import PipelineReport


def show_run_report(report: PipelineReport) -> None:
    """Leaves what each stage came to as the artifact ``pipeline-report``."""
    rows = [
        {"stage": s.name, "status": s.status, "what came of it": s.summary, "seconds": round(s.seconds, 1)}
        for s in report.stages
    ]
    shown = table_rows(rows)
    create_table_artifact(
        table=shown, key=artifact_key(report.name, "pipeline-report"), description=f"{report.name}: {report.run}"
    )
