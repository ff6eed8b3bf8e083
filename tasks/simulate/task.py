"""One chunk of a batch as a Prefect task."""

import time
from collections.abc import Callable
from pathlib import Path

from prefect import task
from prefect.cache_policies import NO_CACHE

from specs.episode import EpisodeResult
from tasks.simulate.batch import KIND, chunks_of, commit_chunk, plan_of
from tasks.simulate.runner import simulate_chunk as simulate_lanes
from tasks.storage.opening import open_store
from tasks.storage.records import read


@task(name="simulate-chunk", task_run_name="simulate-chunk-{number}", cache_policy=NO_CACHE, persist_result=False)
def simulate_chunk(
    store_url: str,
    batch: str,
    number: int,
    *,
    bundles: dict[str, Path],
    left_s: float,
    progress: Callable[[int], None],
) -> list[EpisodeResult]:
    """Returns a chunk's results, having committed them; a chunk that was committed before is not simulated again.

    Args:
        store_url: Where the batch's record, worlds and chunks are.
        batch: The batch's id.
        number: The chunk's.
        bundles: Folder of each application's files, by digest.
        left_s: Wall seconds that the batch has left; lanes that need longer are cancelled.
        progress: Told how many of the chunk's episodes are done.
    """
    store = open_store(store_url)
    plan = plan_of(read(store, KIND, batch))
    deadline_s = time.monotonic() + left_s
    return commit_chunk(
        store,
        batch,
        chunks_of(plan)[number],
        lambda chunk, worlds: simulate_lanes(
            chunk,
            worlds,
            bundles,
            lanes=plan.lanes,
            should_stop=lambda: time.monotonic() > deadline_s,
            progress=progress,
        ),
    )
