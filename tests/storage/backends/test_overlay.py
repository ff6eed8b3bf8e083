"""A store to try things on."""

import tracemalloc
from pathlib import Path

import pytest

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.store import Store


def test_what_is_written_is_read_back_and_never_arrives_below(file_store: Store, tmp_path: Path):
    trial = OverlayStore(file_store)
    trial.create("a/new", b"1")
    (tmp_path / "file").write_bytes(b"2")
    trial.upload("a/file", tmp_path / "file")
    trial.download("a/file", tmp_path / "copy")
    assert (trial.get("a/new").body, (tmp_path / "copy").read_bytes()) == (b"1", b"2")
    assert trial.keys("a") == ["a/file", "a/new"]
    assert file_store.keys("a") == []


def test_what_is_below_shows_through_until_it_is_changed(file_store: Store, tmp_path: Path):
    etag = file_store.create("a/old", b"1")
    trial = OverlayStore(file_store)
    assert trial.exists("a/old")
    trial.download("a/old", tmp_path / "copy")
    trial.replace("a/old", b"2", etag)
    assert (trial.get("a/old").body, file_store.get("a/old").body) == (b"2", b"1")
    trial.delete("a/old")
    assert (trial.keys("a"), trial.exists("a/old"), file_store.exists("a/old")) == ([], False, True)
    with pytest.raises(ObjectNotFound):
        trial.get("a/old")


def test_it_keeps_a_stores_promises(file_store: Store):
    file_store.create("taken", b"1")
    trial = OverlayStore(file_store)
    with pytest.raises(ObjectExists):
        trial.create("taken", b"2")
    with pytest.raises(ObjectConflict):
        trial.replace("taken", b"2", "another etag")
    with pytest.raises(ObjectConflict):
        trial.replace("nothing", b"2", "etag")


def test_a_large_file_is_not_taken_into_memory(file_store: Store, tmp_path: Path):
    source, size = tmp_path / "file", 16 << 20
    source.write_bytes(bytes(size))
    trial = OverlayStore(file_store)
    tracemalloc.start()
    try:
        trial.upload("a/file", source)
        source.unlink()  # as callers do whose file is a temporary one
        trial.download("a/file", tmp_path / "copy")
        (entry,) = trial.entries("a")
        assert tracemalloc.get_traced_memory()[1] < size / 2
    finally:
        tracemalloc.stop()
    assert (trial.size("a/file"), (tmp_path / "copy").stat().st_size) == (size, size)
    assert sum(map(len, trial.blocks("a/file", size - 3))) == 3
    assert entry.mark == trial.etag("a/file") == trial.get("a/file").etag
