from pathlib import Path

import pytest

from tasks.storage.jobs.queue import (
    QueueView,
    change_entry,
    enqueue,
    find_entry,
    is_queued,
    leave_queue,
    queued_jobs,
)
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


def test_a_view_shows_the_kinds_that_are_asked_for_and_sees_changes(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    view = QueueView(store, ["world-export-job"])
    enqueue(store, "world-export-job", "mine")
    enqueue(store, "deployment-job", "other")
    before = view.entries()

    changed = change_entry(store, "world-export-job", "mine", attempts=2)

    assert [entry.id for entry in before] == ["mine"]
    assert view.entries() == [changed]
    assert find_entry(store, "world-export-job", "mine") == changed


def test_an_entry_that_has_left_the_queue_is_not_made_again_by_a_change(tmp_path: Path):
    store = open_store(tmp_path.as_uri())

    assert change_entry(store, "world-export-job", "gone", attempts=2) is None
    assert not is_queued(store, "world-export-job", "gone")


def test_a_view_reads_an_entry_once_as_long_as_nobody_changes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    store = open_store(tmp_path.as_uri())
    enqueue(store, "world-export-job", "mine")
    view = QueueView(store, ["world-export-job"])
    first = view.entries()
    monkeypatch.setattr(type(store), "get", None)

    assert view.entries() == first


SOUND = b'{"kind": "world-export-job", "id": "spoilt", "queued_at_s": 1.0}'


@pytest.mark.parametrize("body", [b"{", SOUND.ljust(2 << 20)])
def test_a_damaged_entry_keeps_nobody_from_the_others(tmp_path: Path, body: bytes):
    store = open_store(tmp_path.as_uri())
    enqueue(store, "world-export-job", "mine")
    store.put("queue/world-export-job/spoilt.json", body)
    view = QueueView(store, ["world-export-job"])

    assert [entry.id for entry in view.entries()] == ["mine"]
    assert [entry.id for entry in view.entries()] == ["mine"]
