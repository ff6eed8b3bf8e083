"""The sample of a batch's episodes that is audited: always the same, drawn without listing all episodes."""

import bisect
import hashlib
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.digest import digest
from tasks.simulate.batch.stop import was_left_out
from tasks.simulate.plan.layout import Layout

Rows = Callable[[int], Sequence[EpisodeResult]]


class SampledEpisode(NamedTuple):
    """An episode that is audited.

    Attributes:
        spread: Whether it is one of those spread over the batch, which estimate its flip rate.
    """

    request: EpisodeRequest
    row: EpisodeResult
    spread: bool


def draw_sample(layout: Layout, rows_of: Rows, lanes: int) -> list[SampledEpisode]:
    """Returns the episodes to audit, by index; those that were never driven are left out.

    Half of the lanes go to episodes that failed, where there are so many: they are what a person has to defend, and
    where engines differ most. The others are spread over the batch, whatever came of them, and estimate it without
    bias. Failed ones are looked for in the chunks of such a spread, so that at most as many chunks are read as there
    are lanes. All is drawn from the batch's plan, so that it is the same whenever it is asked.

    Args:
        layout: The batch's episodes.
        rows_of: Gives the rows of a chunk.
        lanes: Most episodes, at least 1.
    """
    seed = digest(layout.plan)
    even = _spread_over(layout, rows_of, lanes, seed)
    read = {row.index: row for chunk in sorted({layout.chunk_of(k) for k in even}) for row in rows_of(chunk)}
    failed = sorted(index for index, row in read.items() if was_driven(row) and row_failed(row))
    chosen = {failed[position] for position in audited_positions(len(failed), lanes // 2, seed)}
    spread = {even[position] for position in audited_positions(len(even), lanes - len(chosen), seed)}
    return [
        SampledEpisode(layout.request(index), read[index], index in spread)
        for index in sorted(chosen | spread)
        if was_driven(read[index])
    ]


def _spread_over(layout: Layout, rows_of: Rows, lanes: int, seed: str) -> list[int]:
    """Returns indices spread over the episodes that a batch did not leave out, ascending."""
    driven = _chunks_driven(layout, rows_of)
    if driven == layout.chunks:
        settings = math.prod(len(values) for values in layout.plan.sweep.values())
        return audited_positions(layout.episodes, lanes, seed, settings)
    begins = list(itertools.accumulate((layout.chunk_size(number) for number in range(driven)), initial=0))
    found: list[int] = []
    for position in audited_positions(begins[-1], lanes, seed):  # in a drawn order, so that no sweep keeps step with it
        number = bisect.bisect_right(begins, position) - 1
        found.append(layout.chunk(number).requests[position - begins[number]].index)
    return sorted(found)


def _chunks_driven(layout: Layout, rows_of: Rows) -> int:
    """Returns how many chunks there are before those that a batch left out when it was ended early."""
    if not layout.plan.shuffled:
        return layout.chunks
    return bisect.bisect_left(range(layout.chunks), 1, key=lambda number: int(was_left_out(rows_of(number))))


def audited_positions(episodes: int, lanes: int, seed: str, cycle: int = 1) -> list[int]:
    """Returns so many positions at most: one drawn from each of as many equal stretches.

    Positions at equal distances would keep step with the matrix, and miss all but a few values of a sweep. The drawn
    ones take the settings of the sweep in turn, in an order that is drawn too.

    Args:
        episodes: How many positions there are.
        lanes: How many to draw.
        seed: What they depend on besides.
        cycle: After how many positions the settings of the sweep come again.
    """
    count = min(lanes, episodes)
    edges = [episodes * k // count for k in range(count)] + [episodes] if count else []
    turns = sorted(range(cycle), key=lambda k: _drawn(f"{seed}/turn/{k}")) if cycle * count <= episodes else [0]
    positions: list[int] = []
    for k, (first, after) in enumerate(itertools.pairwise(edges)):
        to_turn = (turns[k % len(turns)] - first) % len(turns)
        choices = range(first + to_turn, after, len(turns))
        positions.append(choices[_drawn(f"{seed}/{k}") % len(choices)])
    return positions


def _drawn(text: str) -> int:
    """Returns a number that follows from a text, the same with whatever release of whatever library."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest(), "big")


def was_driven(row: EpisodeResult) -> bool:
    """Returns whether an episode was begun and came to an end of its own."""
    return row.status != "Canceled" and row.simulated_s > 0.0


def row_failed(row: EpisodeResult) -> bool:
    """Returns whether the robot did not do its task, or its job failed."""
    return row.status == "Failed" or row.outcome == "Failed"
