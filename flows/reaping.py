"""The flow `reaping`: looks for jobs that nobody works on any more, and after signatures that expire, on a schedule."""

import logging

from prefect import flow
from prefect.artifacts import create_table_artifact

from flows.entry.flow_state import completed_reaping
from flows.entry.result_json import result_serializer
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.resource.abandoned_jobs import ReapedJob
from flows.resource.abandoned_jobs import reap_jobs as reap_store
from flows.resource.withdrawal import renew_metadata_here
from flows.run.abandoned_flow_runs import end_abandoned_flow_runs
from flows.run.events import announce_changes
from specs.artifact_text import table_rows
from tasks.storage.store_url import open_store

_LOG = logging.getLogger(__name__)


@guarded
@flow(name="reaping", persist_result=True, result_serializer=result_serializer())
def reaping(store: StoreParameter = None) -> list[ReapedJob]:
    """Returns the abandoned jobs that were found, and leaves a table of them; see `simyard reap`.

    The flow runs that worked on abandoned runs become Crashed. What the keys in SIMYARD_KEYS have signed is signed
    anew in the second half of its time.

    Args:
        store: URL of the store, or a block's; SIMYARD_STORE, else ``.simyard`` in the working directory.

    Raises:
        TrustRefused: The metadata in the store is not what the keys signed, or is older than it was.
    """
    opened = open_store(store_at(store))
    with announce_changes():
        found = reap_store(opened)
        for flow_run in end_abandoned_flow_runs(opened):
            _LOG.info(
                "flow run %s had no process any more and is Crashed, or Cancelled if somebody asked for it", flow_run
            )
        for line in renew_metadata_here(opened):
            _LOG.warning("%s: simyard fleet keys renew, with its key", line)
    if found:
        rows = table_rows(each.model_dump(mode="json") for each in found)
        create_table_artifact(rows, key="reaped", description=f"{len(found)} jobs that nobody worked on")
    return completed_reaping(found)
