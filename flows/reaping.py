"""The flow `reaping`: looks for jobs that nobody works on any more, on a schedule."""

from prefect import flow
from prefect.artifacts import create_table_artifact

from flows.resource.abandoned_jobs import ReapedJob
from flows.resource.abandoned_jobs import reap_jobs as reap_store
from flows.run.events import announce_changes
from specs.artifact_text import table_rows
from tasks.storage.store_url import open_store


@flow(name="reaping", persist_result=False)
def reaping(store: str | None = None) -> list[ReapedJob]:
    """Returns the abandoned jobs that were found, and leaves a table of them; see `simyard reap`.

    Args:
        store: URL of the store; SIMYARD_STORE, else ``.simyard`` in the working directory.
    """
    with announce_changes():
        found = reap_store(open_store(store))
    if found:
        rows = table_rows(each.model_dump(mode="json") for each in found)
        create_table_artifact(rows, key="reaped", description=f"{len(found)} jobs that nobody worked on")
    return found
