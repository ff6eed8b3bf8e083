"""A run that is worked on is cancelled by its record, or by Prefect; what only interrupts it leaves it open."""

import pytest
from pydantic import JsonValue

from flows.pipeline import run_turns
from flows.pipeline.orchestrator import Orchestrator, orchestrated_by
from flows.pipeline.run_turns import cancelable_run
from specs.errors import StageFailed, StoreError
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import KIND, begin_run, stage_token
from tests.servers.eventually import eventually

IDENTITY: dict[str, JsonValue] = {"flow": "world-export", "spec": {}}


class Cancelling(Orchestrator):
    """An orchestrator whose flow run somebody cancels."""

    @property
    def flow_run_id(self) -> str:
        return "prefects"

    def is_cancelling(self, flow_run_id: str) -> bool:
        return flow_run_id == "prefects"


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction] - used by every test
    monkeypatch.setattr(run_turns, "_LOOK_S", 0.01)


def status(store: Store, run: JobRecord) -> str:
    return read(store, KIND, run.id).status


def _work_until_canceled(store: Store, run: JobRecord, job: JobRecord) -> None:
    advance(store, KIND, run.id, "Canceling")
    eventually(lambda: read(store, job.kind, job.id).status == "Canceled")
    raise StageFailed("Canceled", "canceled on request", job.arn)


def test_the_job_under_way_is_cancelled_as_soon_as_its_run_is(file_store: Store) -> None:
    with begin_run(file_store, IDENTITY) as run:
        job = submit(file_store, "world-export-job", {}, stage_token(run, "world-export"))
        with pytest.raises(StageFailed, match="Canceled"), cancelable_run(file_store, run):
            _work_until_canceled(file_store, run, job)
        assert status(file_store, run) == "Canceled"


def test_a_run_that_was_cancelled_before_it_is_worked_on_begins_nothing(file_store: Store) -> None:
    with begin_run(file_store, IDENTITY) as run:
        advance(file_store, KIND, run.id, "Canceling")
        with pytest.raises(StageFailed, match="canceled on request"), cancelable_run(file_store, run):
            pytest.fail("it began")
        assert status(file_store, run) == "Canceled"


@pytest.mark.parametrize("exc", [KeyboardInterrupt, SystemExit, StoreError])
def test_what_only_interrupts_a_run_leaves_it_to_be_continued(file_store: Store, exc: type[BaseException]) -> None:
    with begin_run(file_store, IDENTITY) as run:
        with pytest.raises(exc), cancelable_run(file_store, run):
            raise exc
        assert status(file_store, run) == "Running"


def test_a_signal_that_prefect_sent_to_cancel_cancels_the_run(file_store: Store) -> None:
    with orchestrated_by(Cancelling()), begin_run(file_store, IDENTITY) as run:
        with pytest.raises(SystemExit), cancelable_run(file_store, run):
            raise SystemExit(143)
        assert status(file_store, run) == "Canceled"


def test_prefects_cancel_reaches_a_flow_run_that_no_worker_started(file_store: Store) -> None:
    with orchestrated_by(Cancelling()), begin_run(file_store, IDENTITY) as run, cancelable_run(file_store, run):
        assert eventually(lambda: status(file_store, run) == "Canceling")
