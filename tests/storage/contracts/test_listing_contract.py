"""What every store tells about the age of what it holds, and what it removes only as long as it is as it was seen."""

import os
import time
from pathlib import Path

import botocore.session
import pytest

from specs.errors import ObjectNotFound
from tasks.storage.backends.local import LocalStore
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.store import Entry, Store

_SECOND_S = 1.1  # an S3 server tells times in whole seconds


def test_one_entry_is_that_of_the_listing(store: Store) -> None:
    store.put("folder/a", b"12")
    assert store.entry("folder/a") == the_entry(store, "folder/a")
    for key in ("folder", "folder/none"):
        with pytest.raises(ObjectNotFound):
            store.entry(key)


def the_entry(store: Store, key: str) -> Entry:
    (found,) = [entry for entry in store.entries("") if entry.key == key]
    return found


def test_a_listing_marks_an_object_anew_when_it_has_another_body(store: Store) -> None:
    marks: list[str] = []
    for body in (b"one", b"two", b"three"):
        store.put("jobs/a", body)
        (entry,) = store.entries("jobs")
        assert entry.mark == store.entries("jobs")[0].mark == store.entry("jobs/a").mark
        marks.append(entry.mark)
    assert len(set(marks)) == 3


def test_entries_are_the_keys_with_their_sizes(store: Store) -> None:
    for size, key in enumerate(("w/b/2", "w/b/1", "w/a", "w/b/c/3", "w/bb/4")):
        store.put(key, b"1" * size)
    assert [(entry.key, entry.size_bytes) for entry in store.entries("w/b")] == [
        ("w/b/1", 1),
        ("w/b/2", 0),
        ("w/b/c/3", 3),
    ]
    assert [entry.key for entry in store.entries("")] == store.keys("")


def test_what_was_written_later_is_younger_by_the_stores_own_clock(store: Store) -> None:
    store.put("first", b"1")
    time.sleep(_SECOND_S)
    store.put("second", b"1")
    first, second, now_s = the_entry(store, "first"), the_entry(store, "second"), store.now_s()
    assert first.written_s < second.written_s <= now_s + 1
    assert now_s - first.written_s < 60


def test_writing_the_same_bytes_again_makes_an_object_young(store: Store) -> None:
    store.put("same", b"1")
    before = the_entry(store, "same")
    time.sleep(_SECOND_S)
    store.put("same", b"1")
    after = the_entry(store, "same")
    assert after.written_s > before.written_s
    assert after.mark != before.mark


def test_an_object_is_removed_as_it_was_listed(store: Store) -> None:
    store.put("a", b"1")
    assert store.delete_unchanged(the_entry(store, "a"))
    assert not store.exists("a")


def test_an_object_that_was_written_since_stays(store: Store) -> None:
    store.put("a", b"1")
    before = the_entry(store, "a")
    store.put("a", b"2")
    assert not store.delete_unchanged(before)
    assert store.get("a").body == b"2"


def test_an_object_that_was_written_again_with_the_same_bytes_stays(store: Store) -> None:
    store.put("a", b"1")
    before = the_entry(store, "a")
    time.sleep(_SECOND_S)
    store.put("a", b"1")
    assert not store.delete_unchanged(before)
    assert store.exists("a")


def test_removing_what_is_gone_is_no_error(store: Store) -> None:
    store.put("a", b"1")
    before = the_entry(store, "a")
    store.delete("a")
    assert store.delete_unchanged(before)


def test_of_whole_objects_nothing_is_unfinished(store: Store, tmp_path: Path) -> None:
    (tmp_path / "source").write_bytes(b"1")
    store.put("a/b", b"1")
    store.upload("a/c", tmp_path / "source")
    assert store.unfinished("") == []


def test_what_a_killed_writer_left_is_found_and_removed(store: Store) -> None:
    store.put("folder/whole", b"1")
    leave_unfinished(store, "folder/left")
    leave_unfinished(store, "other/left")
    (left,) = store.unfinished("folder")
    assert left.key.startswith("folder/")
    assert abs(left.written_s - store.now_s()) < 60
    store.discard(left)
    store.discard(left)
    assert (store.unfinished("folder"), len(store.unfinished(""))) == ([], 1)
    assert store.get("folder/whole").body == b"1"


def leave_unfinished(store: Store, key: str) -> None:
    """Leaves what a writer leaves that is killed before its object has appeared."""
    if isinstance(store, LocalStore):
        path = store.root / Path(key).parent / f".tmp-{Path(key).name}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"half")
        return
    bucket, _, prefix = store.url.removeprefix("s3://").partition("/")
    client = botocore.session.Session().create_client("s3", endpoint_url=os.environ["AWS_ENDPOINT_URL_S3"])
    client.create_multipart_upload(Bucket=bucket, Key=f"{prefix}/{key}")
    client.close()


def test_a_trial_store_shows_what_is_written_to_it_and_removes_nothing_below(file_store: Store) -> None:
    file_store.put("old", b"12")
    trial = OverlayStore(file_store)
    trial.put("new", b"123")
    assert [(entry.key, entry.size_bytes) for entry in trial.entries("")][:2] == [("new", 3), ("old", 2)]
    assert trial.delete_unchanged(the_entry(trial, "old"))
    with pytest.raises(ObjectNotFound):
        trial.get("old")
    assert file_store.exists("old")
