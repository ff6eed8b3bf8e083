"""Chunks that are made ready while another one drives: what goes wrong with them is not that one's."""

import errno
from collections.abc import Callable, Mapping

import pytest

from specs.data.episode import Failure
from specs.errors import BundleRefused, StoreAway
from tasks.simulate.batch import chunk_runner
from tasks.simulate.batch.chunk_runner import coming_chunks
from tasks.simulate.batch.commit import PreparedChunk, prepared_chunk
from tasks.simulate.batch.job import OpenBatch
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

        monkeypatch.setattr(chunk_runner, "prepared_chunk", prepared)

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
