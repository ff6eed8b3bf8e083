"""Marks of the flow run that is under way: the tag of its run, and a label that names its process.

Prefect's `tags` reaches only the runs that begin inside its block.
"""

import contextvars
import logging
import threading

from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import FlowRun
from prefect.context import FlowRunContext

from tasks.storage.jobs.holder import this_process

PROCESS = "simyard.process"
logger = logging.getLogger(__name__)


def tag_flow_run(tag: str) -> None:
    """Adds a tag to this flow run, if this is in one; a server that does not take it harms no run."""
    flow_run = _this_flow_run()
    if flow_run is None or tag in flow_run.tags:
        return
    try:
        with get_client(sync_client=True) as client:
            client.update_flow_run(flow_run.id, tags=[*flow_run.tags, tag])
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run goes on
        logger.warning("this flow run is without the tag %s: %s", tag, exc)


def label_process(*, is_queued: bool = False) -> None:
    """Notes which process works on this flow run, so that reaping sees when it is dead.

    Prefect's SQLite may answer 503 at the start of a flow run, and its client then waits for two seconds. The work of a
    queued job does not wait for that: its flow run is found by the job's tag when its worker is dead.

    Args:
        is_queued: Whether the flow run is of a queued job.
    """
    flow_run = _this_flow_run()
    if flow_run is not None and not is_queued:
        _label(flow_run)
    elif flow_run is not None:
        context = contextvars.copy_context()  # so that it asks the same server
        threading.Thread(target=context.run, args=(_label, flow_run), name="label of the process", daemon=True).start()


def _label(flow_run: FlowRun) -> None:
    try:
        with get_client(sync_client=True) as client:
            client.update_flow_run_labels(flow_run.id, {PROCESS: this_process().model_dump_json()})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run goes on
        logger.info("Prefect was not told which process works on flow run %s: %s", flow_run.id, exc)


def _this_flow_run() -> FlowRun | None:
    context = FlowRunContext.get()
    return context.flow_run if context and isinstance(context.flow_run, FlowRun) else None
