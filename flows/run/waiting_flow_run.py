"""The page of a flow run that waits for another one's work: it says for whose, and gives its place at a worker back.

A flow run of a deployment holds a place: of its worker (``--limit``), of its deployment's limit. Where it only waits,
it is scheduled anew instead, and its process ends; a worker begins it again later, to look again. A label of the flow
run says for which run it waits, so that it tells that one's result, and does not begin the next. A plain Python
program, `simyard run` and a stage in the process of another flow hold no such place, and wait where they are.
"""

import logging
from datetime import UTC, datetime, timedelta
from typing import Any

from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import FlowRun, State, StateType
from prefect.context import FlowRunContext
from prefect.exceptions import Pause
from prefect.states import Running, Scheduled

WAITING = "Waiting"
AWAITING = "AwaitingOtherRun"
AWAITED = "simyard.awaited-run"
_PATIENCE_S = 5.0
# A look costs a start of a process: seconds of a core. So the pauses grow; who waits learns the end so much later.
_FIRST_PAUSE_S = 30
_LONGEST_PAUSE_S = 240
logger = logging.getLogger(__name__)


def show_wait(sentence: str) -> None:
    """Makes the state of this flow run Running (Waiting), with a sentence that names the other process."""
    flow_run = _this_flow_run()
    if flow_run and not _holds_place(flow_run):
        _set_state(flow_run, Running(name=WAITING, message=sentence))


def leave_place(sentence: str, run: str) -> None:
    """Ends this process if its flow run holds a place while another process, which lives, does the work.

    Args:
        sentence: Names the other process.
        run: Id of the run that it works on, which this flow run waits for when it has come again, too.

    Raises:
        Pause: The flow run is scheduled anew; Prefect's engine ends the process for it.
    """
    flow_run = _this_flow_run()
    if not flow_run or not _holds_place(flow_run) or not _label(flow_run, run):
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
        _label(flow_run, "")
    return run


def next_pause_s(starts: int) -> int:
    """Returns how long a flow run stays away that has begun so many times."""
    return min(_FIRST_PAUSE_S * 2 ** max(0, starts - 1), _LONGEST_PAUSE_S)


def _this_flow_run() -> FlowRun | None:
    context = FlowRunContext.get()
    return context.flow_run if context and isinstance(context.flow_run, FlowRun) else None


def _holds_place(flow_run: FlowRun) -> bool:
    return flow_run.deployment_id is not None


def _set_state(flow_run: FlowRun, state: State[Any]) -> State[Any] | None:
    """Returns the state that Prefect accepted; None if it did not, for example because the flow run is cancelled."""
    try:
        with get_client(httpx_settings={"timeout": _PATIENCE_S}, sync_client=True) as client:
            found = client.read_flow_run(flow_run.id)
            if found.state_type != StateType.RUNNING:
                return None
            return client.set_flow_run_state(flow_run.id, state).state
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told that %s: %s", state.message, exc)
        return None


def _label(flow_run: FlowRun, run: str) -> bool:
    """Returns whether Prefect has noted for which run this flow run waits."""
    try:
        with get_client(httpx_settings={"timeout": _PATIENCE_S}, sync_client=True) as client:
            client.update_flow_run_labels(flow_run.id, {AWAITED: run})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told for which run flow run %s waits: %s", flow_run.id, exc)
        return False
    return True


def _forget_process(flow_run: FlowRun) -> None:
    # Who cancels a scheduled flow run that had a process leaves it Cancelling for minutes: nobody looks after it.
    # The client's own method cannot empty the field.
    try:
        with get_client(httpx_settings={"timeout": _PATIENCE_S}, sync_client=True) as client:
            path = {"id": flow_run.id}
            client.request("PATCH", "/flow_runs/{id}", path_params=path, json={"infrastructure_pid": None})
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the run is waited for
        logger.info("Prefect was not told that the process of %s ends: %s", flow_run.id, exc)
