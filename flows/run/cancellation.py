"""What Prefect says of a cancellation, and what it is told of one."""

import logging
import os
from typing import Any
from uuid import UUID

from prefect import Flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import FlowRun, State
from prefect.states import Cancelled

from flows.resource.cancel import CANCELED, cancel_run
from flows.run.store_block import store_at
from flows.stage.cancellation import PATIENCE_S
from specs.errors import StageFailed
from tasks.storage.jobs.records import is_terminal, records
from tasks.storage.jobs.runs import FLOW_RUN, KIND
from tasks.storage.store_url import open_store

logger = logging.getLogger(__name__)


def is_cancelling(flow_run_id: str) -> bool:
    """Returns whether Prefect's server says that somebody cancels a flow run; False if it says nothing."""
    if not flow_run_id:
        return False
    try:
        with get_client(httpx_settings={"timeout": PATIENCE_S}, sync_client=True) as client:
            state = client.read_flow_run(UUID(flow_run_id)).state
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.debug("Prefect did not say whether %s is canceled: %s", flow_run_id, exc)
        return False
    return state is not None and (state.is_cancelling() or state.is_cancelled())


def canceled_state(failure: StageFailed) -> State[Any]:
    """Returns what Prefect shall call a flow run whose run was cancelled.

    Raises:
        StageFailed: It was not: the failure itself.
    """
    if failure.code != CANCELED:
        raise failure
    return Cancelled(message=f"{failure.reason} ({failure.arn})" if failure.arn else failure.reason)


def cancel_with_flow_run(flow: Flow[..., Any], flow_run: FlowRun, state: State[Any]) -> None:  # noqa: ARG001 - Prefect's
    """Cancels what a flow run worked on, when Prefect has cancelled it and its process could not do so before its end.

    Prefect calls this where the flow run was started: in its worker.
    """
    own_environment: dict[str, str] = (flow_run.job_variables or {}).get("env") or {}
    url = flow_run.parameters.get("store") or own_environment.get("SIMYARD_STORE") or os.environ.get("SIMYARD_STORE")
    if not url:  # a pool of containers does not show its environment, and the worker's folder is not their store
        logger.warning("flow run %s was canceled, and its worker has no SIMYARD_STORE: cancel its job", flow_run.id)
        return
    store = open_store(store_at(url))
    for run in records(store, KIND):
        if run.detail.get(FLOW_RUN) == str(flow_run.id) and not is_terminal(run):
            cancel_run(store, run.id)
