"""A batch's report in Prefect's pages: in short, and its picture."""

import base64

from prefect.artifacts import create_image_artifact, create_markdown_artifact

from flows.batch_report import report_view_of
from tasks.results.report.markdown import report_markdown
from tasks.results.report.page import report_picture
from tasks.storage.records import JobRecord
from tasks.storage.store import Store


def show_report_of_batch(store: Store, record: JobRecord) -> None:
    """Leaves the report of a closed batch, in short, as the artifacts ``batch-report`` and ``batch-picture``."""
    view = report_view_of(store, record)
    url = str(record.detail.get("report_url", ""))
    create_markdown_artifact(report_markdown(view, url), key="batch-report", description=f"Report of {record.id}")
    picture = base64.b64encode(report_picture(view)).decode()
    create_image_artifact(
        f"data:image/svg+xml;base64,{picture}", key="batch-picture", description=f"Rate and failures of {record.id}"
    )
