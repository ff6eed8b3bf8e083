"""Simulates a few episodes of a batch again, drawn after the fact, and compares them bit for bit.

Who forges a share f of the rows is found by n episodes with probability 1 - (1 - f)^n: a tenth of them by 8 in 57 %, by
30 in 96 % of all cases. It is the second line: no row is counted that the owner does not vouch for.
"""

import platform
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from random import Random, SystemRandom

from specs.data.episode import CANCELED, EpisodeResult
from specs.errors import StageFailed
from tasks.simulate.batch.chunk_runner import ChunkRunner
from tasks.simulate.batch.chunk_store import counted_chunk, row_changes
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.replay.resimulate import resimulate
from tasks.storage.base.keys import chunk_key

_CHUNKS_KEPT = 4
_SAME_BITS = frozenset({"x86_64", "AMD64"})
_SHOWN = 3
# Of a batch that was ended early most episodes may have been left out.
_DRAWS_EACH = 50


def sample_changes(batch: OpenBatch, bundles: Mapping[str, Path], most: int, draw: Random | None = None) -> list[str]:
    """Returns which of some episodes come out otherwise when they are simulated again, one line each.

    None are drawn where a lane's last bits may depend on its place (docs/decisions/0004).

    Args:
        batch: All its chunks are committed.
        bundles: Unpacked folders of its applications, by digest.
        most: How many episodes to draw.
        draw: Draws them; unpredictable, if not given.
    """
    drawn = _drawn(batch, most, draw or SystemRandom())
    runner = ChunkRunner(bundles, batch.plan.engine, batch.plan.recordings.rateHz, lambda _: None)
    again = resimulate(batch, [batch.layout.request(row.index) for row in drawn], runner.run)
    changes = [
        f"{batch.store.url}/{chunk_key(batch.id, batch.layout.chunk_of(row.index))}: {change}"
        for row, computed in zip(drawn, again, strict=True)
        for change in row_changes([row], [computed])
    ]
    more = (
        [f"{len(changes)} of {len(drawn)} episodes came out otherwise when they were simulated again"]
        if changes
        else []
    )
    return [*changes[:_SHOWN], *more]


def _drawn(batch: OpenBatch, most: int, draw: Random) -> list[EpisodeResult]:
    """Returns the rows of episodes that came to an end, without the names of their recordings."""
    rows_of = lru_cache(_CHUNKS_KEPT)(lambda number: _rows(batch, number))
    episodes, found = batch.layout.episodes, dict[int, EpisodeResult]()
    for _ in range(_DRAWS_EACH * most):
        if len(found) >= min(most, episodes):
            break
        index = draw.randrange(episodes)
        row = rows_of(batch.layout.chunk_of(index))[index]
        if row.status != CANCELED and row.device != "gpu" and platform.machine() in _SAME_BITS:
            found[index] = row.model_copy(update={"recording": ""})
    return [found[index] for index in sorted(found)]


def _rows(batch: OpenBatch, number: int) -> dict[int, EpisodeResult]:
    rows = counted_chunk(batch.store, batch.id, number, batch.voucher)
    if rows is None:
        raise StageFailed("MismatchedEtag", f"{batch.store.url}/{chunk_key(batch.id, number)} is gone")
    return {row.index: row for row in rows}
