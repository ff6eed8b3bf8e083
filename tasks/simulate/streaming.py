"""The results of a batch in the order of its jobs, a part at a time, so that a large one fits into memory."""

from collections.abc import Iterator

from specs.episode import EpisodeRequest, EpisodeResult
from specs.errors import ObjectNotFound
from tasks.simulate.batch import OpenBatch
from tasks.simulate.chunk_store import committed_chunk
from tasks.simulate.stopping import canceled_row

# Some 40 MB if all of them failed and left long trajectories.
PART_EPISODES = 2048
# Each part of a shuffled batch is spread over all of its chunks, which are read again for the next one.
SHUFFLED_PART_EPISODES = 16_384
STOP_CODES = {
    "Canceling": "BatchCanceled",
    "Canceled": "BatchCanceled",
    "TimingOut": "BatchTimedOut",
    "TimedOut": "BatchTimedOut",
}


def parts(batch: OpenBatch) -> Iterator[tuple[list[EpisodeRequest], list[EpisodeResult]]]:
    """Yields a batch's episodes by index, some at a time, and a result for each.

    Episodes of a batch that was stopped before they began are Canceled.

    Raises:
        ObjectNotFound: A chunk of a batch that was not stopped is not committed.
    """
    code = STOP_CODES.get(batch.record().status, "")
    size = SHUFFLED_PART_EPISODES if batch.plan.shuffled else PART_EPISODES
    for first in range(0, batch.layout.episodes, size):
        end = min(first + size, batch.layout.episodes)
        requests = list(batch.layout.requests(first, end))
        yield requests, _results(batch, first, end, code)


def _results(batch: OpenBatch, first: int, end: int, code: str) -> list[EpisodeResult]:
    found: dict[int, EpisodeResult] = {}
    for number in batch.layout.chunks_between(first, end):
        rows = committed_chunk(batch.store, batch.id, number)
        if rows is None and not code:
            raise ObjectNotFound(f"{batch.store.url}: chunk {number} of {batch.id} is not committed")
        found.update((row.index, row) for row in rows or () if first <= row.index < end)
    return [found.get(index) or canceled_row(index, code) for index in range(first, end)]
