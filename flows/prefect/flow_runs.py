"""The flow run that is under way, and those whose process died: marks, waits, cancellation, and their end.

A flow run of a deployment holds a place at a worker. Where it only waits for another one's work, it is scheduled anew,
and its process ends. A process learns of its flow run's cancellation by an event of Prefect at once, else by a question
in 10 s: the event needs a WebSocket, which an older server lacks and a proxy may refuse. A worker tells Prefect when a
process that it started is gone; of other processes whoever holds the claim of Simyard's run says so here.
"""

import asyncio
import contextvars
import logging
import os
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

from prefect import Flow
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
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.context import FlowRunContext
from prefect.events.clients import get_events_subscriber
from prefect.events.filters import EventFilter, EventNameFilter, EventResourceFilter
from prefect.exceptions import ObjectNotFound, Pause
from prefect.states import Cancelled, Crashed, Running, Scheduled
from prefect.utilities.urls import url_for
from pydantic import ValidationError

from flows.pipeline.run_turns import PATIENCE_S
from flows.prefect.parameters import store_at
from flows.resources.kinds import CANCELED, cancel_run
from specs.errors import StageFailed
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ProcessIdentity, hold_claim_unless_alive, is_known_dead, this_process
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, KIND
from tasks.storage.store_url import open_store

PROCESS = "simyard.process"
logger = logging.getLogger(__name__)


# Prefect's `tags` reaches only the runs that begin inside its block.
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
        _label_process(flow_run)
    elif flow_run is not None:
        context = contextvars.copy_context()  # so that it asks the same server
        threading.Thread(
            target=context.run, args=(_label_process, flow_run), name="label of the process", daemon=True
        ).start()


def _label_process(flow_run: FlowRun) -> None:
    try:
        with get_client(sync_client=True) as client:
            client.update_flow_run_labels(flow_run.id, {PROCESS: this_process().model_dump_json()})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run goes on
        logger.info("Prefect was not told which process works on flow run %s: %s", flow_run.id, exc)


def _this_flow_run() -> FlowRun | None:
    context = FlowRunContext.get()
    return context.flow_run if context and isinstance(context.flow_run, FlowRun) else None


WAITING = "Waiting"
AWAITING = "AwaitingOtherRun"
AWAITED = "simyard.awaited-run"
_ANSWER_S = 5.0
# A look costs a start of a process: seconds of a core. So the pauses grow; who waits learns the end so much later.
_FIRST_PAUSE_S = 30
_LONGEST_PAUSE_S = 240


# A flow run of a deployment holds a place: of its worker (``--limit``), of its deployment's limit. Where it only
# waits, it is scheduled anew instead, and its process ends; a worker begins it again later, to look again. A label of
# the flow run says for which run it waits, so that it tells that one's result, and does not begin the next. A plain
# Python program, `simyard run` and a stage in the process of another flow hold no such place, and wait where they
# are.
def show_waiting(sentence: str) -> None:
    """Makes the state of this flow run Running (Waiting), with a sentence that names the other process."""
    flow_run = _this_flow_run()
    if flow_run and not _holds_place(flow_run):
        _set_state(flow_run, Running(name=WAITING, message=sentence))


def requeue_run(sentence: str, run: str) -> None:
    """Ends this process if its flow run holds a place while another process, which lives, does the work.

    Args:
        sentence: Names the other process.
        run: Id of the run that it works on, which this flow run waits for when it has come again, too.

    Raises:
        Pause: The flow run is scheduled anew; Prefect's engine ends the process for it.
    """
    flow_run = _this_flow_run()
    if not flow_run or not _holds_place(flow_run) or not _label_awaited(flow_run, run):
        return
    pause_s = next_pause_s(flow_run.run_count)
    again = datetime.now(UTC) + timedelta(seconds=pause_s)
    state = Scheduled(name=AWAITING, scheduled_time=again, message=f"{sentence}; looks again in {pause_s} s")
    accepted = _set_state(flow_run, state)
    if accepted and accepted.is_scheduled():
        _forget_process(flow_run)
        logger.info("%s; this process ends, and the flow run begins again in %d s", sentence, pause_s)
        raise Pause(state=accepted)


def show_work() -> None:
    """Makes the state of this flow run Running again, if it was Waiting."""
    flow_run = _this_flow_run()
    if flow_run and not _holds_place(flow_run):
        _set_state(flow_run, Running())


def awaited_run() -> str:
    """Returns the id of the run that this flow run waited for when it left; empty if it did not.

    It says so once, so that a person who has the flow run started again gets a run of its own.
    """
    flow_run = _this_flow_run()
    run = str(flow_run.labels.get(AWAITED) or "") if flow_run else ""
    if flow_run and run:
        _label_awaited(flow_run, "")
    return run


def next_pause_s(starts: int) -> int:
    """Returns how long a flow run stays away that has begun so many times."""
    return min(_FIRST_PAUSE_S * 2 ** max(0, starts - 1), _LONGEST_PAUSE_S)


def _holds_place(flow_run: FlowRun) -> bool:
    return flow_run.deployment_id is not None


def _set_state(flow_run: FlowRun, state: State[Any]) -> State[Any] | None:
    """Returns the state that Prefect accepted; None if it did not, for example because the flow run is cancelled."""
    try:
        with get_client(httpx_settings={"timeout": _ANSWER_S}, sync_client=True) as client:
            found = client.read_flow_run(flow_run.id)
            if found.state_type != StateType.RUNNING:
                return None
            return client.set_flow_run_state(flow_run.id, state).state
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told that %s: %s", state.message, exc)
        return None


def _label_awaited(flow_run: FlowRun, run: str) -> bool:
    """Returns whether Prefect has noted for which run this flow run waits."""
    try:
        with get_client(httpx_settings={"timeout": _ANSWER_S}, sync_client=True) as client:
            client.update_flow_run_labels(flow_run.id, {AWAITED: run})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told for which run flow run %s waits: %s", flow_run.id, exc)
        return False
    return True


def _forget_process(flow_run: FlowRun) -> None:
    # Who cancels a scheduled flow run that had a process leaves it Cancelling for minutes: nobody looks after it.
    # The client's own method cannot empty the field.
    try:
        with get_client(httpx_settings={"timeout": _ANSWER_S}, sync_client=True) as client:
            path = {"id": flow_run.id}
            client.request("PATCH", "/flow_runs/{id}", path_params=path, json={"infrastructure_pid": None})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told that the process of %s ends: %s", flow_run.id, exc)


QUESTION_S = 10.0
_RECONNECTIONS = 3
_NEXT_TRY_S = 60.0
_EVENTS = ["prefect.flow-run.Cancelling", "prefect.flow-run.Cancelled"]


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


@contextmanager
def watch_cancellation(
    flow_run: str, now_s: Callable[[], float] = time.monotonic
) -> Generator[Callable[[], bool], None, None]:
    """Yields a function that says whether a flow run is cancelled, and that may be called often.

    Args:
        flow_run: Its id; empty for none, which nobody cancels.
        now_s: A clock that never goes back.
    """
    if not flow_run:
        yield lambda: False
        return
    canceled, next_s = threading.Event(), now_s()

    def is_canceled() -> bool:
        nonlocal next_s
        if not canceled.is_set() and now_s() >= next_s:
            next_s = now_s() + QUESTION_S
            if is_cancelling(flow_run):
                canceled.set()
        return canceled.is_set()

    with _listening(flow_run, canceled):
        yield is_canceled


@contextmanager
def _listening(flow_run: str, canceled: threading.Event) -> Generator[None, None, None]:
    """Sets an event as soon as Prefect tells of the cancellation, inside the ``with`` block."""
    loop = asyncio.new_event_loop()
    left = asyncio.Event()

    def listen() -> None:
        with suppress(RuntimeError), asyncio.Runner(loop_factory=lambda: loop) as runner:  # or the interpreter ends
            runner.run(_listen_until(flow_run, canceled, left))

    context = contextvars.copy_context()  # so that it asks the same server
    thread = threading.Thread(target=context.run, args=(listen,), name=f"events of {flow_run}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        with suppress(RuntimeError):  # it has ended
            loop.call_soon_threadsafe(left.set)


async def _listen_until(flow_run: str, canceled: threading.Event, left: asyncio.Event) -> None:
    listening = asyncio.create_task(_listen(flow_run, canceled))
    leaving = asyncio.create_task(left.wait())
    await asyncio.wait({listening, leaving}, return_when=asyncio.FIRST_COMPLETED)
    for task in (listening, leaving):
        task.cancel()
    await asyncio.gather(listening, leaving, return_exceptions=True)


async def _listen(flow_run: str, canceled: threading.Event) -> None:
    wanted = EventFilter(
        event=EventNameFilter(name=_EVENTS), resource=EventResourceFilter(id=[f"prefect.flow-run.{flow_run}"])
    )
    while not canceled.is_set():
        try:
            async with get_events_subscriber(filter=wanted, reconnection_attempts=_RECONNECTIONS) as events:
                async for _ in events:
                    canceled.set()
                    return
        except Exception as exc:  # noqa: BLE001 - whatever a server or a proxy makes of it, the questions are asked
            logger.info("no events of %s, which is asked after every %.0f s: %s", flow_run, QUESTION_S, exc)
        await asyncio.sleep(_NEXT_TRY_S)


_ENDED = frozenset({StateType.COMPLETED, StateType.FAILED, StateType.CRASHED, StateType.CANCELLED})
_UNDER_WAY = (StateType.RUNNING, StateType.PENDING, StateType.CANCELLING)
_END_WITHIN_S = 20.0
_GRACE_S = 120.0
_PAGE = 200


# A worker tells Prefect when a process that it started is gone, and only of that flow run, not of the stages below
# it. Of a `simyard run` or a plain Python program that was killed, nobody tells: its flow run stays Running. Whoever
# holds the claim of Simyard's run knows that the process which held it before is dead, and says so here.
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
    return get_client(httpx_settings={"timeout": _END_WITHIN_S}, sync_client=True)


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
