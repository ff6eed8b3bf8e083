"""A batch's record names the machines that worked on it, each once."""

import pytest

from tasks.simulate.batch import provenance
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.provenance import another_gl, note_gl, note_machine
from tasks.simulate.devices import device_count
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun


def noted(detail: dict[str, object]) -> list[object]:
    return [value for key, value in detail.items() if key.startswith("machine/")]


def test_this_machine_is_noted_once(file_store: Store):
    batch = begun(file_store)
    for _ in range(2):
        note_machine(batch)
    (machine,) = noted(dict(batch.record().detail))
    assert isinstance(machine, dict)
    assert (machine["device"], machine["devices"]) == ("cpu", device_count())
    assert machine["name"]
    assert batch.record().status == "InProgress"


def test_a_batch_that_goes_on_elsewhere_names_both(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    batch = begun(file_store)
    note_machine(batch)
    monkeypatch.setattr(provenance, "_processor", lambda: "another")
    note_machine(batch)
    assert len(noted(dict(batch.record().detail))) == 2


def test_which_gl_drew_is_noted_and_another_one_is_told(file_store: Store):
    batch = begun(file_store)
    assert another_gl(batch.record(), "egl: one") == "", "records of older versions name none"
    for _ in range(2):
        note_gl(batch, "osmesa: llvmpipe")
    record = batch.record()
    assert [key for key in record.detail if key.startswith("gl/")] == ["gl/osmesa: llvmpipe"]
    assert another_gl(record, "osmesa: llvmpipe") == another_gl(record, "") == ""
    assert another_gl(record, "egl: one") == "its pictures were drawn by osmesa: llvmpipe, and now are by egl: one"


def test_a_batch_that_is_being_stopped_stays_so(file_store: Store):
    batch = begun(file_store)
    cancel_batch(file_store, batch.id)
    note_machine(batch)
    assert batch.record().status == "Canceling"
