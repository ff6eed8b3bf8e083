"""Works on a batch as the flow does, without Prefect, so that a test can kill it many times in little time.

python -m tests.integration.stopped.batch_worker STORE_URL BATCH
"""

import sys
from functools import partial

from flows.batch.batch_end import close_with_tables
from flows.cli.terminal import exit_with_code
from specs.data.episode import EpisodeResult
from specs.field_types import OutputLocation
from tasks.results.tables.recordings import write_recordings
from tasks.simulate.batch.batch_record import OpenBatch, complete, load_batch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.storage.store_url import open_store
from tests.factories.simulations import FOLDERS, simulate_lanes

PLACE = OutputLocation(s3Bucket="results")


def work(batch: OpenBatch) -> None:
    """Commits every chunk, writes the tables and closes the batch."""
    record = partial(write_recordings, batch.store.url, PLACE, batch.id)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, _simulate, record, lanes=batch.plan.lanes, left_s=3600.0)
    complete(batch)
    close_with_tables(batch)


def _simulate(part: ChunkPart) -> list[EpisodeResult]:
    return simulate_lanes(
        part.chunk,
        part.worlds,
        FOLDERS,
        lanes=part.lanes,
        engine="planar",
        should_stop=part.watch,
        recorder=part.recorder,
    )


if __name__ == "__main__":
    with exit_with_code():
        work(load_batch(open_store(sys.argv[1]), sys.argv[2]))
