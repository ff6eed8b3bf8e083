from pathlib import Path

from tasks.storage.jobs.queue import enqueue, is_queued, leave_queue, queued_jobs
from tasks.storage.store_url import open_store


def test_the_queue_is_in_the_order_in_which_jobs_came_whatever_their_kind(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    enqueue(store, "world-export-job", "b")
    enqueue(store, "deployment-job", "a", {"sync": True})

    found = queued_jobs(store)

    assert [(entry.kind, entry.id) for entry in found] == [("world-export-job", "b"), ("deployment-job", "a")]
    assert found[1].options == {"sync": True}


def test_a_job_that_is_queued_again_keeps_its_place(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    enqueue(store, "world-export-job", "first")
    enqueue(store, "world-export-job", "second")
    before = queued_jobs(store)

    enqueue(store, "world-export-job", "first")

    assert queued_jobs(store) == before


def test_a_job_that_left_the_queue_is_not_in_it(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    enqueue(store, "world-export-job", "only")

    leave_queue(store, "world-export-job", "only")

    assert not is_queued(store, "world-export-job", "only")
    assert queued_jobs(store) == []
