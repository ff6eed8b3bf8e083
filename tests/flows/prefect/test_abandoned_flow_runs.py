"""Flow runs of dead processes end on a real server, with their stages; others are left alone."""

from collections.abc import Callable
from uuid import UUID, uuid4

import pytest
from prefect import Flow, Task, flow
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run as running_flow_run
from prefect.states import AwaitingRetry, Cancelling, Completed, Crashed, Paused, Running

from flows.pipeline.run_turns import cancelable_run
from flows.prefect import flow_runs
from flows.prefect.flow_runs import (
    PROCESS,
    cancel_with_flow_run,
    end_abandoned_flow_run,
    end_abandoned_flow_runs,
    end_flow_run_before,
)
from flows.prefect.prefect_orchestrator import under_prefect
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ProcessIdentity, this_process
from tasks.storage.jobs.records import JobRecord, advance, read
from tasks.storage.jobs.runs import FLOW_RUN, KIND, begin_run
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.long, pytest.mark.usefixtures("client")]
FLOW = Flow(lambda: None, name="abandoned")
TASK = Task(lambda: None, name="stage")


def flow_run(client: SyncPrefectClient, state: State) -> UUID:
    """Returns the id of a new flow run in a state."""
    made = client.create_flow_run(FLOW, state=Running()).id
    client.set_flow_run_state(made, state, force=True)
    return made


def stage_below(client: SyncPrefectClient, parent: UUID) -> tuple[UUID, UUID]:
    """Returns the ids of a task run, and of the flow run of a stage that it stands for; both are Running."""
    task = client.create_task_run(TASK, parent, dynamic_key=uuid4().hex, state=Running()).id
    return task, client.create_flow_run(FLOW, parent_task_run_id=task, state=Running()).id


def state(client: SyncPrefectClient, run: UUID) -> State:
    found = client.read_flow_run(run).state
    assert found
    return found


def worked_on_by(store: Store, own: UUID) -> JobRecord:
    """Returns a run that a flow run worked on, and whose claim nobody holds."""
    with begin_run(store, {"flow": "world-export", "spec": {}}) as run:
        return advance(store, KIND, run.id, "Running", detail={FLOW_RUN: str(own)})


def ended_of(store: Store, *ours: UUID) -> list[UUID]:
    """Returns which of some flow runs a look after a store ends; the server has those of other tests, too."""
    ended = end_abandoned_flow_runs(store)
    return [each for each in ours if str(each) in ended]


def test_a_flow_run_that_was_taken_over_is_crashed_with_its_stages_and_names_its_successor(
    client: SyncPrefectClient, file_store: Store
) -> None:
    before, after = flow_run(client, Running()), flow_run(client, Running())
    task, stage = stage_below(client, before)
    run = worked_on_by(file_store, before)
    end_flow_run_before(run, str(after))
    assert [state(client, each).name for each in (before, stage, after)] == ["Crashed", "Crashed", "Running"]
    message = str(state(client, before).message)
    assert (run.arn in message, str(after) in message, "/runs/flow-run/" in message) == (True, True, True)
    ended = client.read_task_run(task).state
    assert ended
    assert ended.is_crashed()


def test_a_flow_run_that_goes_on_with_its_own_run_is_not_ended(client: SyncPrefectClient, file_store: Store) -> None:
    own = flow_run(client, Running())
    end_flow_run_before(worked_on_by(file_store, own), str(own))
    assert state(client, own).is_running()


def test_the_stages_of_a_flow_run_that_its_worker_called_crashed_end_too(client: SyncPrefectClient) -> None:
    top = flow_run(client, Running())
    _, stage = stage_below(client, top)
    client.set_flow_run_state(top, Crashed(message="as the worker said"), force=True)
    end_abandoned_flow_run(str(top), "why")
    assert (state(client, top).message, state(client, stage).name) == ("as the worker said", "Crashed")


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        (Cancelling, "Cancelled"),
        (AwaitingRetry, "AwaitingRetry"),
        (Paused, "Paused"),
        (Completed, "Completed"),
    ],
)
def test_what_prefect_or_a_person_has_decided_stays(
    client: SyncPrefectClient, was: Callable[[], State], becomes: str
) -> None:
    found = flow_run(client, was())  # made now: a pause has an end
    _, stage = stage_below(client, found)
    end_abandoned_flow_run(str(found), "why")
    # What will be started again finds its stages, and Prefect goes on with them.
    assert (state(client, found).name, state(client, stage).is_running()) == (
        becomes,
        becomes in {"AwaitingRetry", "Paused"},
    )


def test_a_flow_run_that_was_only_thought_dead_still_ends_as_it_says(client: SyncPrefectClient) -> None:
    found = flow_run(client, Running())
    end_abandoned_flow_run(str(found), "why")
    client.set_flow_run_state(found, Completed(message="it lived"))
    assert state(client, found).message == "it lived"


def test_a_flow_run_on_another_server_changes_nothing(caplog: pytest.LogCaptureFixture) -> None:
    end_abandoned_flow_run(str(uuid4()), "why")
    assert "could not be ended" not in caplog.text


def test_a_look_after_a_store_ends_the_flow_runs_of_dead_processes_only(
    client: SyncPrefectClient, file_store: Store
) -> None:
    dead, alive = flow_run(client, Running()), flow_run(client, Running())
    worked_on_by(file_store, dead)
    with begin_run(file_store, {"flow": "world-export", "spec": {"other": 1}}) as run:
        advance(file_store, KIND, run.id, "Running", detail={FLOW_RUN: str(alive)})
        assert ended_of(file_store, dead, alive) == [dead]
    assert [state(client, each).name for each in (dead, alive)] == ["Crashed", "Running"]
    assert eventually(lambda: ended_of(file_store, dead, alive) == [alive])  # its process has let it go


def test_a_run_that_has_just_ended_is_left_to_its_process(client: SyncPrefectClient, file_store: Store) -> None:
    last = flow_run(client, Running())
    advance(file_store, KIND, worked_on_by(file_store, last).id, "Completed")
    assert ended_of(file_store, last) == []
    assert state(client, last).is_running()


def labelled(client: SyncPrefectClient, process: ProcessIdentity) -> UUID:
    """Returns a Running flow run that no run names, and that a process works on."""
    made = flow_run(client, Running())
    client.update_flow_run_labels(made, {PROCESS: process.model_dump_json()})
    return made


def test_a_flow_run_that_no_run_names_ends_when_its_process_on_this_machine_is_dead(
    client: SyncPrefectClient, file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = this_process()
    dead = labelled(client, here.model_copy(update={"started": "1"}))
    alive, away = labelled(client, here), labelled(client, here.model_copy(update={"host": "other", "started": "1"}))
    assert ended_of(file_store, dead, alive, away) == []  # a new process may be about to write its label
    monkeypatch.setattr(flow_runs, "_GRACE_S", 0.0)
    assert ended_of(file_store, dead, alive, away) == [dead]
    assert [state(client, each).name for each in (dead, alive, away)] == ["Crashed", "Running", "Running"]


def test_a_flow_run_whose_work_a_process_without_prefect_took_over_is_ended_after_it(
    client: SyncPrefectClient, file_store: Store
) -> None:
    before = flow_run(client, Running())
    run = worked_on_by(file_store, before)
    with begin_run(file_store, run.request) as taken, cancelable_run(file_store, taken):
        stopped = client.read_flow_run(before).model_copy(update={"parameters": {"store": file_store.url}})
        cancel_with_flow_run(FLOW, stopped, Cancelling())
        assert read(file_store, KIND, run.id).status == "Running"
        assert ended_of(file_store, before) == []
    assert eventually(lambda: ended_of(file_store, before) == [before])


def test_each_flow_of_simyards_notes_its_process(client: SyncPrefectClient) -> None:
    @flow
    def body() -> str:
        with under_prefect():
            return str(running_flow_run.id)

    labels = client.read_flow_run(UUID(body())).labels
    assert ProcessIdentity.model_validate_json(str(labels[PROCESS])) == this_process()
