"""A batch's report in Prefect's pages: in short, and its picture."""

import base64

from prefect.artifacts import create_image_artifact, create_markdown_artifact

from flows.batch_report import Reported
from tasks.results.report.markdown import report_markdown
from tasks.results.report.page import report_picture


def show_report(reported: Reported) -> None:
    """Leaves a report, in short, as the artifacts ``batch-report`` and ``batch-picture`` of the run of the flow."""
    view, batch = reported.view, reported.view.facts.batch
    create_markdown_artifact(report_markdown(view, reported.url), key="batch-report", description=f"Report of {batch}")
    picture = base64.b64encode(report_picture(view)).decode()
    create_image_artifact(
        f"data:image/svg+xml;base64,{picture}", key="batch-picture", description=f"Rate and failures of {batch}"
    )
