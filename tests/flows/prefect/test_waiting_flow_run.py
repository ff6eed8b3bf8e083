"""A flow run that waits says so on a real server, and goes where it keeps a place from others."""

from contextlib import AbstractContextManager
from typing import Any
from uuid import UUID

import pytest
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.objects import FlowRun, State
from prefect.context import FlowRunContext
from prefect.exceptions import Pause
from prefect.results import ResultStore
from prefect.states import Cancelling, Running
from prefect.task_runners import ThreadPoolTaskRunner

from flows.prefect.flow_runs import AWAITING, WAITING, awaited_run, next_pause_s, requeue_run, show_waiting, show_work

pytestmark = [pytest.mark.integration, pytest.mark.long, pytest.mark.usefixtures("client")]
FLOW = Flow(lambda: None, name="waiting")
RUN = "run-0123456789abcdef"
SENTENCE = "process 1 works on arn:x, and this run waits for its result"


def by_hand(client: SyncPrefectClient) -> FlowRun:
    return client.create_flow_run(FLOW, state=Running())


def by_a_worker(client: SyncPrefectClient) -> FlowRun:
    """Returns a flow run of a deployment, as a worker's process has it."""
    made = client.create_flow_run(FLOW, state=Running())
    client.update_flow_run(made.id, infrastructure_pid="host:1")
    return made.model_copy(update={"deployment_id": UUID(int=1), "run_count": 1})


def inside(flow_run: FlowRun) -> AbstractContextManager[Any]:
    """Makes the block the body of a flow run."""
    return FlowRunContext(
        flow=FLOW,
        flow_run=flow_run,
        client=get_client(),
        task_runner=ThreadPoolTaskRunner(),
        result_store=ResultStore(),
        parameters={},
    )


def state(client: SyncPrefectClient, flow_run: FlowRun) -> State:
    found = client.read_flow_run(flow_run.id).state
    assert found
    return found


def test_it_names_in_its_state_whom_it_waits_for_and_then_works(client: SyncPrefectClient) -> None:
    flow_run = by_hand(client)
    with inside(flow_run):
        show_waiting(SENTENCE)
        waits = state(client, flow_run)
        show_work()
    assert (waits.name, waits.is_running(), waits.message) == (WAITING, True, SENTENCE)
    assert state(client, flow_run).name == "Running"


def test_without_a_worker_it_stays(client: SyncPrefectClient) -> None:
    flow_run = by_hand(client)
    with inside(flow_run):
        requeue_run(SENTENCE, RUN)
    assert state(client, flow_run).is_running()


def test_at_a_worker_it_gives_its_place_back_and_comes_again(client: SyncPrefectClient) -> None:
    flow_run = by_a_worker(client)
    with inside(flow_run), pytest.raises(Pause):
        requeue_run(SENTENCE, RUN)
    left = state(client, flow_run)
    assert (left.name, left.is_scheduled(), left.message) == (AWAITING, True, f"{SENTENCE}; looks again in 30 s")


def test_come_again_it_knows_once_for_which_run_it_waited(client: SyncPrefectClient) -> None:
    flow_run = by_a_worker(client)
    with inside(flow_run), pytest.raises(Pause):
        requeue_run(SENTENCE, RUN)
    with inside(client.read_flow_run(flow_run.id)):
        assert awaited_run() == RUN
    with inside(client.read_flow_run(flow_run.id)):
        assert not awaited_run()  # who has it started again wants a new run


def test_cancelled_while_it_is_away_it_is_cancelled_at_once(client: SyncPrefectClient) -> None:
    flow_run = by_a_worker(client)
    with inside(flow_run), pytest.raises(Pause):
        requeue_run(SENTENCE, RUN)
    client.set_flow_run_state(flow_run.id, Cancelling())
    assert state(client, flow_run).is_cancelled()


def test_one_that_is_being_cancelled_does_not_come_again(client: SyncPrefectClient) -> None:
    flow_run = by_a_worker(client)
    client.set_flow_run_state(flow_run.id, Cancelling())
    with inside(flow_run):
        show_waiting(SENTENCE)
        requeue_run(SENTENCE, RUN)
    assert state(client, flow_run).is_cancelling()


def test_it_stays_away_longer_each_time_and_four_minutes_at_most() -> None:
    assert [next_pause_s(starts) for starts in range(1, 7)] == [30, 60, 120, 240, 240, 240]
