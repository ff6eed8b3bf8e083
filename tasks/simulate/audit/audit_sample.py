"""The sample of a batch's episodes that is audited: two strata, drawn so that each lane knows what it stands for.

Episodes that passed are one stratum, all others the other one. A lane's weight is the inverse of the probability that
it was drawn, so that weighted sums over the sample estimate those over the batch without bias (Horvitz and Thompson
1952, JASA 47:663), whatever share of the lanes each stratum gets.
"""

import bisect
import hashlib
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, EpisodeResult, success
from tasks.simulate.batch.batch_record import was_left_out
from tasks.simulate.plan.episode_layout import Layout

Rows = Callable[[int], Sequence[EpisodeResult]]
# Draws a number from 0 to below another one; the text says what for.
Pick = Callable[[str, int], int]
# One lane in so many goes to episodes that failed. What passes wrongly ships, and a failure that is none costs a look.
FAILED_ONE_IN = 4


class SampledEpisode(NamedTuple):
    """An episode that is audited.

    Attributes:
        weight: For how many of the batch's episodes it stands, at least 1.
    """

    request: EpisodeRequest
    row: EpisodeResult
    weight: float


class _Member(NamedTuple):
    """An episode that may be drawn, and for how many it stands because not all chunks are read."""

    row: EpisodeResult
    weight: int


def draw_sample(
    layout: Layout, rows_of: Rows, lanes: int, pick: Pick | None = None, *, chunks: int | None = None
) -> list[SampledEpisode]:
    """Returns the episodes to audit, by index; those that were never driven are left out.

    A quarter of the lanes goes to episodes that failed, where there are so many, and the rest to those that passed;
    what one stratum has no use for goes to the other. At most as many chunks are read as there are lanes: one of each
    of so many equal stretches. Within a stratum the episodes stand in the order of their settings and then of their
    numbers, and one is drawn from each of equal stretches: so all settings and worlds are audited in proportion.

    Args:
        layout: The batch's episodes.
        rows_of: Gives the rows of a chunk.
        lanes: Most episodes, at least 1.
        pick: Draws; by default from the batch's plan, so that the sample is the same whenever it is asked.
        chunks: How many chunks a batch has driven that may be ended now; None of one that has ended.
    """
    draw = pick or plan_picks(layout.plan_digest)
    driven = _chunks_driven(layout, rows_of) if chunks is None else chunks
    members = _members(layout, rows_of, lanes, draw, driven)
    passed = [each for each in members if success(each.row)]
    failed = [each for each in members if not success(each.row)]
    of_failed = min(len(failed), max(failed_lanes(lanes), lanes - len(passed)))
    drawn = [
        *_drawn(layout, passed, min(len(passed), lanes - of_failed), "passed", draw),
        *_drawn(layout, failed, of_failed, "failed", draw),
    ]
    return sorted(drawn, key=lambda each: each.row.index)


def failed_lanes(lanes: int) -> int:
    """Returns how many lanes go to episodes that failed, if there are so many and no lack of passed ones."""
    return max(lanes // FAILED_ONE_IN, min(1, lanes - 1))


def plan_picks(seed: str) -> Pick:
    """Returns draws that follow from a text, the same with whatever release of whatever library."""

    def pick(what: str, below: int) -> int:
        return int.from_bytes(hashlib.sha256(f"{seed}/{what}".encode()).digest(), "big") % below

    return pick


def stretches(size: int, count: int) -> list[range]:
    """Returns positions cut into equal stretches, whose sizes differ by one at most.

    Args:
        size: How many positions there are.
        count: How many stretches, if there are as many positions.
    """
    number = min(size, count)
    return [range(size * k // number, size * (k + 1) // number) for k in range(number)]


def _members(layout: Layout, rows_of: Rows, lanes: int, pick: Pick, chunks: int) -> list[_Member]:
    """Returns the driven episodes of the chunks that are read, those with the same setting together."""
    found: list[_Member] = []
    for k, stretch in enumerate(stretches(chunks, lanes)):
        rows = rows_of(stretch[pick(f"chunk/{k}", len(stretch))])
        found += [_Member(row, len(stretch)) for row in rows if was_driven(row)]
    settings = math.prod(len(values) for values in layout.plan.sweep.values())
    seeds = layout.turns
    return sorted(found, key=lambda each: (each.row.index // seeds % settings, each.row.index))


def _drawn(layout: Layout, members: Sequence[_Member], count: int, name: str, pick: Pick) -> list[SampledEpisode]:
    found: list[SampledEpisode] = []
    for k, stretch in enumerate(stretches(len(members), count)):
        row, weight = members[stretch[pick(f"{name}/{k}", len(stretch))]]
        found.append(SampledEpisode(layout.request(row.index), row, float(weight * len(stretch))))
    return found


def _chunks_driven(layout: Layout, rows_of: Rows) -> int:
    """Returns how many chunks there are before those that a batch left out when it was ended early."""
    if not layout.plan.shuffled:
        return layout.chunks
    return bisect.bisect_left(range(layout.chunks), 1, key=lambda number: int(was_left_out(rows_of(number))))


def was_driven(row: EpisodeResult) -> bool:
    """Returns whether an episode was begun and came to an end of its own."""
    return row.status != "Canceled" and row.simulated_s > 0.0
