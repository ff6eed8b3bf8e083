"""A batch goes through RoboMaker's states, and what it holds does not grow with its jobs.

See docs/reference/robomaker.md, section 4.
"""

import pytest

from specs.errors import IdempotentParameterMismatch
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.batch_record import close_batch, complete, open_batch, terminal_state, time_out
from tasks.storage.base.store import Store, encode_document
from tests.factories.planned_batches import begun, plan, request, template


def test_a_batch_is_opened_once_and_found_again(file_store: Store):
    first, again = begun(file_store), begun(file_store)
    assert (first.id, first.record().status) == (again.id, "InProgress")
    with pytest.raises(IdempotentParameterMismatch):
        begun(file_store, plan(file_store, seeds=(5,)))


@pytest.mark.parametrize(("stop", "status"), [("Canceling", "Canceled"), ("TimingOut", "TimedOut")])
def test_a_batch_that_is_being_stopped_does_not_go_on_by_being_opened_again(file_store: Store, stop: str, status: str):
    batch = begun(file_store)
    if stop == "Canceling":
        cancel_batch(file_store, batch.id)
    else:
        time_out(batch)
    assert open_batch(file_store, batch.plan, request(batch.plan), "tok").status == stop
    assert complete(batch).status == stop
    assert terminal_state(batch.record(), 0)[0] == status


def test_a_cancelled_batch_does_not_time_out_and_the_other_way_round(file_store: Store):
    cancelled, late = begun(file_store, name="a"), begun(file_store, name="b")
    cancel_batch(file_store, cancelled.id)
    time_out(late)
    assert time_out(cancelled).status == "Canceling"
    assert late.record().status == "TimingOut"


def test_jobs_that_failed_do_not_fail_the_batch_unless_it_was_our_fault(file_store: Store):
    batch = begun(file_store)
    record = complete(batch)
    assert terminal_state(record, 0) == ("Completed", "")
    assert terminal_state(record, 2)[0] == "Failed"
    failed = close_batch(file_store, batch.id, *("Failed", {}, "no memory"))
    assert (failed.status, failed.failure_code) == ("Failed", "InternalServiceError")


def test_a_cancelled_batch_is_canceled_and_a_late_one_failed_if_jobs_failed_by_our_fault(file_store: Store):
    cancelled, late = begun(file_store, name="a"), begun(file_store, name="b")
    assert terminal_state(cancel_batch(file_store, cancelled.id), 1)[0] == "Canceled"
    assert terminal_state(time_out(late), 1)[0] == "Failed"


def test_a_record_does_not_grow_with_worlds_times_requests_times_seeds(file_store: Store):
    worlds = tuple(f"g/w{number}" for number in range(100))
    few = plan(file_store, worlds=worlds, templates=(template(),) * 2, seeds=tuple(range(2)))
    many = plan(file_store, worlds=worlds, templates=(template(),) * 20, seeds=tuple(range(500)))
    sizes = [len(encode_document(begun(file_store, made, token).record())) for made, token in ((few, "a"), (many, "b"))]
    assert begun(file_store, many, "b").layout.episodes == 1_000_000
    assert sizes[1] - sizes[0] < 20_000
