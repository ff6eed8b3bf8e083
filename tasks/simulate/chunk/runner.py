"""The entry of the simulation: takes a chunk of episodes, returns their rows.

This module imports no JAX itself, so that importing it is cheap and JAX's settings can still be made.
"""

import contextlib
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from specs.data.world import World
from tasks.simulate.devices import prepare_devices
from tasks.simulate.lane.recording import SampleRecorder
from tasks.simulate.plan.chunks import Chunk

if TYPE_CHECKING:
    from specs.data.episode_columns import EpisodeColumns
    from tasks.simulate.chunk.chunk_pipeline import ChunkPipeline


def simulate_columns(
    chunk: Chunk,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    should_stop: Callable[[], bool],
    progress: Callable[[int], None] = lambda _: None,
    recorder: SampleRecorder | None = None,
    pipeline: "ChunkPipeline | None" = None,
    ahead: Sequence[Chunk] = (),
) -> "EpisodeColumns":
    """Returns the results of a chunk's episodes as columns, in request order.

    Whatever goes wrong inside an episode is its row: applications that do not import, raise or return what is not
    finite; worlds that are missing; states that blow up. The other rows are the same bits without it.

    Args:
        chunk: At most ``lanes`` episodes that share a program.
        worlds: By ``<generation>/<world>``; more than the chunk needs are ignored.
        bundles: Unpacked folders of the chunk's applications, by digest.
        lanes: How many lanes every chunk of the batch is padded to.
        engine: ``auto``, or the engine that must run them (``tasks.simulate.engines.engine_table``).
        should_stop: Asked every 1.25 simulated seconds; episodes not done by then are Canceled.
        progress: Told as often how many of the chunk's episodes are done.
        recorder: Given what the lanes do.
        pipeline: What of this chunk, and of those that follow, is simulated already; None to simulate it by itself.
        ahead: Chunks that are going to be asked for after it, in their order; ``worlds`` has theirs, too.

    Raises:
        JaxAlreadyImported: JAX was imported before its settings could be made.
    """
    prepare_devices()
    with contextlib.redirect_stdout(io.StringIO()):  # MJX prints that its optional Warp backend is missing
        from tasks.simulate.chunk.chunk_simulation import simulate_episodes  # noqa: PLC0415 - JAX reads its settings when imported

    return simulate_episodes(
        chunk,
        worlds,
        bundles,
        lanes=lanes,
        engine=engine,
        should_stop=should_stop,
        progress=progress,
        recorder=recorder,
        pipeline=pipeline,
        ahead=ahead,
    )
