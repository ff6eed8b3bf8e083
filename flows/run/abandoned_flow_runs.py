"""The end of abandoned flow runs: Prefect hears that their process died, and who went on with their work.

A worker tells Prefect when a process that it started is gone, and only of that flow run, not of the stages below it.
Of a `simyard run` or a plain Python program that was killed, nobody tells: its flow run stays Running. Whoever holds
the claim of Simyard's run knows that the process which held it before is dead, and says so here.
"""

import logging
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.filters import (
    FlowRunFilter,
    FlowRunFilterParentFlowRunId,
    FlowRunFilterState,
    FlowRunFilterStateType,
    FlowRunFilterTags,
    TaskRunFilter,
    TaskRunFilterFlowRunId,
    TaskRunFilterState,
    TaskRunFilterStateType,
)
from prefect.client.schemas.objects import FlowRun, StateType
from prefect.exceptions import ObjectNotFound
from prefect.states import Cancelled, Crashed
from prefect.utilities.urls import url_for
from pydantic import ValidationError

from flows.run.flow_run_marks import PROCESS
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.holder import ProcessIdentity, is_known_dead
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, KIND

_ENDED = frozenset({StateType.COMPLETED, StateType.FAILED, StateType.CRASHED, StateType.CANCELLED})
_UNDER_WAY = (StateType.RUNNING, StateType.PENDING, StateType.CANCELLING)
_PATIENCE_S = 20.0
_GRACE_S = 120.0
_PAGE = 200
logger = logging.getLogger(__name__)


def end_flow_run_before(run: JobRecord, own: str) -> None:
    """Ends the flow run that a run was worked on in before this process took it over, if it is another one.

    Args:
        run: As it was when this process had taken its claim.
        own: Id of the flow run that goes on with it; empty for none.
    """
    before = str(run.detail.get(FLOW_RUN) or "")
    if own and before and before != own:
        page = url_for("flow-run", obj_id=own)
        went_on = f"flow run {own} goes on with {run.arn}" + (f": {page}" if page else "")
        end_abandoned_flow_run(before, f"Its process ended without a word; {went_on}")


def end_flow_runs_before(tag: str, own: str, message: str) -> None:
    """Ends the flow runs under way with a tag, but for this process's own; their process is known to be dead.

    Args:
        tag: The id of a queued job, whose turn is this process's.
        own: Id of the flow run that goes on with it.
        message: For their pages.
    """
    try:
        with _client() as client:
            found = client.read_flow_runs(
                flow_run_filter=FlowRunFilter(tags=FlowRunFilterTags(all_=[tag]), state=_under_way_filter())
            )
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the work goes on
        logger.warning("Prefect did not say which flow runs worked on %s before: %s", tag, exc)
        return
    for flow_run in found:
        if str(flow_run.id) != own:
            end_abandoned_flow_run(str(flow_run.id), message)


def end_abandoned_flow_runs(store: Store) -> list[str]:
    """Ends the flow runs under way that worked on runs of a store, and whose process is dead; returns their ids.

    A process that lives holds the claim of its run, and is seen to renew it. A flow run on a server that this process
    does not know is left alone, as is everything if the server does not answer.

    Args:
        store: Where the runs are; their records name the flow runs.
    """
    try:
        with _client() as client:
            under_way = {str(each.id): each for each in _flow_runs_under_way(client)}
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the store is what counts
        logger.warning("Prefect did not say which flow runs are under way: %s", exc)
        return []
    suspects = [run for run in records(store, KIND) if _flow_run_of(run) in under_way and not _ends_now(run)]
    ended = [flow_run for run in suspects for flow_run in _end_unless_alive(store, run)]
    for flow_run in [name for name, each in under_way.items() if name not in ended and _is_process_dead(each)]:
        end_abandoned_flow_run(flow_run, "Its process ended without a word")
        ended.append(flow_run)
    return ended


def _flow_run_of(run: JobRecord) -> str:
    return str(run.detail.get(FLOW_RUN) or run.detail.get(FLOW_RUN_BEFORE) or "")


def _is_process_dead(flow_run: FlowRun) -> bool:
    """Returns whether the process that a flow run's label names certainly runs no more: it was one of this machine.

    No run names such a flow run: it waited for another one's work, or had not begun. One that a new process begins at
    this moment still has the label of the old one, so its state must have stood for a while.
    """
    label, state = flow_run.labels.get(PROCESS), flow_run.state
    if not label or state is None or datetime.now(UTC) - state.timestamp < timedelta(seconds=_GRACE_S):
        return False
    try:
        return is_known_dead(ProcessIdentity.model_validate_json(str(label)))
    except ValidationError:
        return False


def _ends_now(run: JobRecord) -> bool:
    """Returns whether a run has just ended: the process that ended it still tells Prefect so."""
    return is_terminal(run) and time.time() - run.updated_at_s < _GRACE_S


def _end_unless_alive(store: Store, suspect: JobRecord) -> Iterator[str]:
    with hold_claim_unless_alive(store, claim_key(KIND, suspect.id)) as claim:
        if claim is None:
            return
        run = read(store, KIND, suspect.id)  # whoever took it meanwhile has ended the flow run before
        flow_run = _flow_run_of(run)
        if flow_run == _flow_run_of(suspect):
            end_abandoned_flow_run(flow_run, f"Its process ended without a word, and nobody works on {run.arn}")
            yield flow_run


def end_abandoned_flow_run(flow_run: str, message: str) -> None:
    """Makes a flow run Crashed whose process is known to be dead, with what ran in that process.

    One that was being cancelled is Cancelled. One that has ended stays what it is, and what is left of its stages ends.
    One that Prefect will start again (Scheduled, AwaitingRetry, Pending) or that somebody paused is left alone.

    Args:
        flow_run: Its id; that it is unknown to the server, or the server away, changes nothing.
        message: For its page: why, and who goes on.
    """
    try:
        with _client() as client:
            found = client.read_flow_run(UUID(flow_run))
            if found.state_type in {StateType.RUNNING, StateType.CANCELLING, *_ENDED}:
                _end_with_children(client, found, message)
    except ObjectNotFound:
        logger.info("flow run %s is not on this Prefect server", flow_run)
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the work goes on
        logger.warning("flow run %s, whose process is dead, could not be ended: %s", flow_run, exc)


def _client() -> SyncPrefectClient:
    return get_client(httpx_settings={"timeout": _PATIENCE_S}, sync_client=True)


def _under_way_filter() -> FlowRunFilterState:
    return FlowRunFilterState(type=FlowRunFilterStateType(any_=[StateType.RUNNING, StateType.CANCELLING]))


def _flow_runs_under_way(client: SyncPrefectClient) -> Iterator[FlowRun]:
    state, offset = _under_way_filter(), 0
    while page := client.read_flow_runs(flow_run_filter=FlowRunFilter(state=state), limit=_PAGE, offset=offset):
        yield from page
        offset += len(page)


def _end_with_children(client: SyncPrefectClient, flow_run: FlowRun, message: str) -> None:
    # From the stages up: who is killed in between leaves the top as it was, and the next one does this again.
    state = FlowRunFilterState(type=FlowRunFilterStateType(any_=list(_UNDER_WAY)))
    below = FlowRunFilter(parent_flow_run_id=FlowRunFilterParentFlowRunId(any_=[flow_run.id]), state=state)
    for child in client.read_flow_runs(flow_run_filter=below, limit=_PAGE):
        if child.deployment_id is None:  # else it has a process of its own
            _end_with_children(client, child, message)
    tasks = TaskRunFilter(
        flow_run_id=TaskRunFilterFlowRunId(any_=[flow_run.id]),
        state=TaskRunFilterState(type=TaskRunFilterStateType(any_=list(_UNDER_WAY))),
    )
    for task in client.read_task_runs(task_run_filter=tasks, limit=_PAGE):
        client.set_task_run_state(task.id, _end_state(task.state_type, message), force=True)
    if flow_run.state_type not in _ENDED:
        client.set_flow_run_state(flow_run.id, _end_state(flow_run.state_type, message), force=True)
        logger.warning("flow run %s: %s", flow_run.id, message)


def _end_state(was: StateType | None, message: str) -> Any:  # noqa: ANN401 - a state of no result
    return (Cancelled if was == StateType.CANCELLING else Crashed)(message=message)
