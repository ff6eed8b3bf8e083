"""What a batch's end imports is imported while its episodes are driven, and what was made ready ends with the batch."""

import sys
from collections.abc import Callable
from threading import enumerate as all_threads

import pytest

from flows.pipeline import batch_run
from flows.prefect import spread_work
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import PreparedChunk, prepared_chunk
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun, plan

NOBODYS = "plistlib"  # of the standard library, and imported by nobody here
RESULTS = OutputLocation(s3Bucket="results")


def test_modules_are_imported_and_those_that_are_missing_left_to_who_needs_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, NOBODYS, raising=False)
    monkeypatch.setattr(batch_run, "_NEEDED_AT_THE_END", ("no_such_module", NOBODYS))

    batch_run._import_ahead()  # pyright: ignore[reportPrivateUsage]

    for thread in all_threads():
        if thread.name == "simyard imports":
            thread.join()
    assert NOBODYS in sys.modules


def on_a_worker(batch: OpenBatch) -> None:
    spread_work._simulate_numbers(batch, (0, 1), RESULTS, left_s=9.0, spent_s=0.0)  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize("run", [lambda batch: batch_run.run_batch(batch.store, batch.id, RESULTS), on_a_worker])
def test_chunks_that_were_made_ready_early_end_with_a_batch_that_breaks_off(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, run: Callable[[OpenBatch], None]
):
    batch, early = begun(file_store, plan(file_store, audit=0)), list[PreparedChunk]()

    def breaks_off(*_: object, **__: object) -> None:
        early.append(prepared_chunk(batch, 1, {}))
        assert prepared_chunk(batch, 1, {}) is early[0]
        raise StageFailed("InternalServiceError", "the store is away")

    for module, name in ((batch_run, "_simulate_here"), (spread_work, "simulate_chunk")):
        monkeypatch.setattr(module, name, breaks_off)
    with pytest.raises(StageFailed, match="the store is away"):
        run(batch)
    assert prepared_chunk(batch, 1, {}) is not early[0]
