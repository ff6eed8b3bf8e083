"""Which episodes of a batch are audited: the same ones whenever it is asked, found without listing them all."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from specs.episode import EpisodeRequest, EpisodeResult
from tasks.simulate.layout import Layout


class Sampled(NamedTuple):
    """An episode that is audited.

    Attributes:
        spread: Whether it is one of those evenly spread over the batch, which estimate its flip rate.
    """

    request: EpisodeRequest
    row: EpisodeResult
    spread: bool


def sampled(layout: Layout, rows_of: Callable[[int], Sequence[EpisodeResult]], lanes: int) -> list[Sampled]:
    """Returns the episodes to audit, by index; those that were never driven are left out.

    Half of the lanes go to episodes that failed, where there are so many: they are what a person has to defend, and
    where engines differ most. The others are evenly spread, whatever came of them, and estimate the batch without
    bias. Failed ones are looked for in the chunks of an even spread, so that at most as many chunks are read as there
    are lanes.

    Args:
        layout: The batch's episodes.
        rows_of: Gives the rows of a chunk.
        lanes: Most episodes, at least 1.
    """
    even = audited_positions(layout.episodes, lanes)
    read = {row.index: row for chunk in sorted({layout.chunk_of(k) for k in even}) for row in rows_of(chunk)}
    failed = sorted(index for index, row in read.items() if was_driven(row) and row_failed(row))
    chosen = {failed[position] for position in audited_positions(len(failed), lanes // 2)}
    spread = {even[position] for position in audited_positions(len(even), lanes - len(chosen))}
    return [
        Sampled(layout.request(index), read[index], index in spread)
        for index in sorted(chosen | spread)
        if was_driven(read[index])
    ]


def audited_positions(episodes: int, lanes: int) -> list[int]:
    """Returns so many positions at most, evenly spread from the first to the last."""
    return sorted({int(position) for position in np.linspace(0, episodes - 1, min(lanes, episodes)).round()})


def was_driven(row: EpisodeResult) -> bool:
    """Returns whether an episode was begun and came to an end of its own."""
    return row.status != "Canceled" and row.simulated_s > 0.0


def row_failed(row: EpisodeResult) -> bool:
    """Returns whether the robot did not do its task, or its job failed."""
    return row.status == "Failed" or row.outcome == "Failed"
