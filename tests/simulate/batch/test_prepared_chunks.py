"""A chunk is made ready once, also early; what keeps a coming one from that fails no other."""

import errno
from collections.abc import Callable, Mapping

import pytest

from specs.data.episode import Failure
from specs.errors import BundleRefused, StoreAway
from tasks.simulate.batch import chunk_run
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import PreparedChunk, coming_chunks, forget_chunks, prepared_chunk
from tasks.simulate.data.data_sources import PinnedSource
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun, plan

FAULTS = [
    StoreAway("the store does not answer"),
    OSError(errno.ENOSPC, "no space left on device"),
    BundleRefused("the archive holds a link"),
]
Break = Callable[[int, Exception], None]


@pytest.fixture
def batch(file_store: Store) -> OpenBatch:
    """Returns a batch of three chunks."""
    return begun(file_store, plan(file_store, seeds=tuple(range(6))))


@pytest.fixture
def break_chunk(monkeypatch: pytest.MonkeyPatch) -> Break:
    """Lets the making ready of a chunk fail."""

    def broken(number: int, error: Exception) -> None:
        def prepared(batch: OpenBatch, asked: int, unusable: Mapping[str, Failure]) -> PreparedChunk:
            if asked == number:
                raise error
            return prepared_chunk(batch, asked, unusable)

        monkeypatch.setattr(chunk_run, "prepared_chunk", prepared)

    return broken


@pytest.mark.parametrize("error", FAULTS)
def test_a_chunk_that_cannot_be_made_ready_yet_is_told_to_the_log_and_fails_no_other(
    batch: OpenBatch, break_chunk: Break, error: Exception, caplog: pytest.LogCaptureFixture
):
    break_chunk(1, error)
    assert coming_chunks(batch, (1, 2), {})() == []
    (said,) = caplog.records
    assert (said.levelname, said.message) == ("WARNING", f"chunk 1 does not begin early: {error}")


def test_the_chunks_before_one_that_cannot_be_made_ready_begin_early(batch: OpenBatch, break_chunk: Break):
    break_chunk(2, FAULTS[0])
    assert [each.asked.number for each in coming_chunks(batch, (1, 2), {})()] == [1]


def test_a_defect_is_not_only_told_to_the_log(batch: OpenBatch, break_chunk: Break):
    break_chunk(1, TypeError("a defect"))
    with pytest.raises(TypeError, match="a defect"):
        coming_chunks(batch, (1, 2), {})()


def test_a_chunk_that_was_made_ready_early_is_the_same_when_it_is_its_turn(batch: OpenBatch):
    (early,) = coming_chunks(batch, (1,), {})()
    assert prepared_chunk(batch, 1, {}).able.requests is early.able.requests


def test_a_chunk_whose_application_cannot_be_used_any_more_is_made_ready_anew(batch: OpenBatch):
    (early,) = coming_chunks(batch, (1,), {})()
    failure = Failure("RobotApplicationCrash", "it is gone")
    found = prepared_chunk(batch, 1, {early.asked.requests[0].robot.digest: failure})
    assert set(found.unable.values()) == {failure}


def test_of_chunks_that_were_made_ready_early_a_few_are_kept(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(chunk_run, "_EARLY", 1)
    first, second = (prepared_chunk(batch, number, {}) for number in (1, 2))
    assert prepared_chunk(batch, 2, {}) is second
    again = prepared_chunk(batch, 1, {})
    assert again == first
    assert again is not first


def test_chunks_that_were_made_ready_early_are_forgotten_at_their_batchs_end(batch: OpenBatch, file_store: Store):
    other = begun(file_store, plan(file_store, seeds=(7, 8, 9)), "another")
    ours, theirs = (prepared_chunk(each, 1, {}) for each in (batch, other))
    forget_chunks(batch)
    assert prepared_chunk(other, 1, {}) is theirs
    assert prepared_chunk(batch, 1, {}) is not ours


def test_chunks_of_two_batches_that_have_one_number_are_told_apart(batch: OpenBatch, file_store: Store):
    other = begun(file_store, plan(file_store, seeds=(7, 8, 9)), "another")
    for each in (batch, other):
        assert prepared_chunk(each, 0, {}).asked == each.layout.chunk(0)


def test_a_chunk_that_reads_data_is_made_ready_when_it_is_its_turn(file_store: Store):
    source = PinnedSource(name="routes", bucket="routes", type="File", destination="data")
    batch = begun(file_store, plan(file_store, data_sources={source.digest: source}))
    (early,) = coming_chunks(batch, (1,), {})()
    assert prepared_chunk(batch, 1, {}) is not early
