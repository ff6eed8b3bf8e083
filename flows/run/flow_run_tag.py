"""The tag of the flow run that is under way: Prefect's `tags` reaches only the runs that begin inside its block."""

import logging

from prefect.client.orchestration import get_client
from prefect.context import FlowRunContext

logger = logging.getLogger(__name__)


def tag_flow_run(tag: str) -> None:
    """Adds a tag to this flow run, if this is in one; a server that does not take it harms no run."""
    context = FlowRunContext.get()
    if context is None or context.flow_run is None or tag in context.flow_run.tags:
        return
    wanted = [*context.flow_run.tags, tag]
    try:
        with get_client(sync_client=True) as client:
            client.update_flow_run(context.flow_run.id, tags=wanted)
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run goes on
        logger.warning("this flow run is without the tag %s: %s", tag, exc)
