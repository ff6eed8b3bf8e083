"""What a chunk does beside its rows: it tags and cancels jobs."""

import pytest

from specs.arn import Reference
from specs.data.episode import EpisodeResult, unfinished_result
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk, tag_jobs
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.lane.result_rows import WITHDRAWN
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of
from tests.factories.planned_batches import all_pass, begun, plan


@pytest.fixture
def tagged(file_store: Store) -> OpenBatch:
    return begun(file_store, plan(file_store, seeds=(1, 2)))


def tags(tagged: OpenBatch, index: int) -> dict[str, str]:
    return tags_of(tagged.store, Reference(kind="simulation-job", path=f"{tagged.id}/{index}"), {})


def test_tags_of_an_application_are_its_jobs(tagged: OpenBatch):
    tag_jobs(tagged, {1: {"found": "a wall"}})
    tag_jobs(tagged, {1: {"found": "a door", "seen": "much"}})
    assert (tags(tagged, 0), tags(tagged, 1)) == ({}, {"found": "a door", "seen": "much"})


def test_tags_that_a_job_cannot_have_are_told_to_the_log_and_end_nothing(
    tagged: OpenBatch, caplog: pytest.LogCaptureFixture
):
    tag_jobs(tagged, {0: {"simyard:outcome": "Passed"}, 1: {"sound": "yes"}})
    assert (tags(tagged, 0), tags(tagged, 1)) == ({}, {"sound": "yes"})
    assert "tags of its application" in caplog.text


def test_a_job_that_its_application_cancels_says_so(tagged: OpenBatch):
    def withdrawn(part: ChunkPart) -> list[EpisodeResult]:
        first, *rest = all_pass(part)
        canceled = unfinished_result(first.index, "Canceled", failure_code="", failure_reason=WITHDRAWN)
        return [canceled, *rest]

    run_chunk(tagged, 0, withdrawn, lanes=4, left_s=9.0)
    rows = committed_chunk(tagged.store, tagged.id, 0)
    assert rows is not None
    assert (rows[0].status, rows[0].failure_code, rows[0].failure_reason) == ("Canceled", "", WITHDRAWN)
