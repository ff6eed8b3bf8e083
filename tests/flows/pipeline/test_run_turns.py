"""A run that another process works on is waited for in sight of everybody, and whoever waits may be cancelled alone."""

from collections.abc import Generator
from contextlib import contextmanager
from threading import Event, Thread

import pytest
from pydantic import JsonValue

from flows.pipeline.orchestrator import Orchestrator, orchestrated_by
from flows.pipeline.run_turns import begin_run_in_turn, require_success, run_stage
from specs.errors import StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read, records, submit
from tasks.storage.jobs.runs import KIND, begin_run

IDENTITY: dict[str, JsonValue] = {"flow": "world-export", "spec": {}}


class Seen(Orchestrator):
    """An orchestrator that notes what is shown; its flow run is cancelled when it is told to."""

    @property
    def flow_run_id(self) -> str:
        return "waits"

    def __init__(self, on_wait: Event | None = None, *, canceled: bool = False) -> None:
        self.shown: list[str] = []
        self._on_wait = on_wait
        self._canceled = canceled

    def is_cancelling(self, flow_run_id: str) -> bool:
        return self._canceled and flow_run_id == self.flow_run_id

    def show_waiting(self, sentence: str) -> None:
        self.shown.append(sentence)
        if self._on_wait:
            self._on_wait.set()

    def show_work(self) -> None:
        self.shown.append("works")


@contextmanager
def worked_on(store: Store, end: Event, status: str) -> Generator[JobRecord, None, None]:
    """Yields a run that a thread works on until an event; the run is in a status then."""
    begun, found = Event(), list[JobRecord]()

    def work() -> None:
        with begin_run(store, IDENTITY) as run:
            found.append(advance(store, KIND, run.id, "Running"))
            begun.set()
            end.wait()
            if status != "Running":
                advance(store, KIND, run.id, status)  # pyright: ignore[reportArgumentType]

    thread = Thread(target=work)
    thread.start()
    begun.wait()
    try:
        yield found[0]
    finally:
        end.set()
        thread.join()


def test_it_says_whom_it_waits_for_and_that_it_works_then(file_store: Store) -> None:
    end = Event()
    seen = Seen(on_wait=end)
    with (
        worked_on(file_store, end, "Running") as run,
        orchestrated_by(seen),
        begin_run_in_turn(file_store, IDENTITY) as taken,
    ):
        assert taken.id == run.id
    assert seen.shown[0].endswith(f"works on {run.arn}, and this run waits for its result")
    assert seen.shown[1:] == ["works"]


def test_it_does_not_work_on_what_the_other_one_has_ended(file_store: Store) -> None:
    end = Event()
    seen = Seen(on_wait=end)
    with (
        worked_on(file_store, end, "Completed"),
        orchestrated_by(seen),
        begin_run_in_turn(file_store, IDENTITY) as run,
    ):
        assert run.status == "Completed"
    assert "works" not in seen.shown


def test_cancelled_while_it_waits_it_ends_and_the_other_one_goes_on(file_store: Store) -> None:
    with worked_on(file_store, Event(), "Completed") as run, orchestrated_by(Seen(canceled=True)):
        with (
            pytest.raises(StageFailed, match="canceled while it waited for process") as canceled,
            begin_run_in_turn(file_store, IDENTITY),
        ):
            pytest.fail("it worked")
        assert (canceled.value.code, read(file_store, KIND, run.id).status) == ("Canceled", "Running")


def test_who_waits_for_nobody_shows_nothing(file_store: Store) -> None:
    seen = Seen()
    with orchestrated_by(seen), begin_run_in_turn(file_store, IDENTITY):
        pass
    assert seen.shown == []


EXPORT = "world-export-job"


def test_a_canceled_job_says_that_somebody_asked_for_it(file_store: Store):
    job = submit(file_store, "world-generation-job", {}, "token").id
    advance(file_store, "world-generation-job", job, "Canceling")
    with pytest.raises(StageFailed, match=r"^Canceled: canceled on request"):
        require_success(advance(file_store, "world-generation-job", job, "Canceled"))


def test_a_flow_run_that_left_its_place_and_came_again_does_not_do_the_work_a_second_time(file_store: Store):
    class ComeAgain(Orchestrator):
        def awaited_run(self) -> str:
            return records(file_store, "pipeline-run")[0].id

    def work(token: str) -> JobRecord:
        job = submit(file_store, EXPORT, {}, token).id
        return advance(file_store, EXPORT, job, "Failed")  # of which no assets are told

    first = run_stage(file_store, "world-export", {"spec": {}}, None, work)
    with orchestrated_by(ComeAgain()):
        assert run_stage(file_store, "world-export", {"spec": {}}, None, work).id == first.id
    assert run_stage(file_store, "world-export", {"spec": {}}, None, work).id != first.id
