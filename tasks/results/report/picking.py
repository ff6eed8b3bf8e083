"""Which failures a report shows: a few that differ, and not the first hundred of one kind."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from tasks.results.report.reading import Failures

# At 24 worlds these are some 400 kB of page, whatever the size of the batch.
LISTED = 6
DRAWN = 24
_APART_M = 0.4


@dataclass(frozen=True)
class Picked:
    """What is shown of one world's failures, as rows of the table of failures.

    Attributes:
        listed: Those that are told one by one, and numbered on the map.
        drawn: Those whose way is drawn, the listed ones among them.
        failures: How many there are in all.
    """

    listed: tuple[int, ...]
    drawn: tuple[int, ...]
    failures: int


def picked(failures: Failures, worlds: Sequence[str]) -> dict[str, Picked]:
    """Returns what is shown of the failures of each of the worlds.

    Reasons take turns, each in the order of the episodes, so that one that is rare is not hidden by one that is not;
    listed are first those that ended apart from one another.
    """
    codes = {name: code for code, name in enumerate(failures.world.names)}
    return {world: _picked(failures, codes.get(world, -1)) for world in worlds}


def _picked(failures: Failures, world: int) -> Picked:
    rows = np.flatnonzero(failures.world.codes == world)
    by_reason = [
        rows[failures.reason.codes[rows] == reason][:DRAWN].tolist() for reason in range(len(failures.reason.names))
    ]
    turns = [row for turn in zip_longest(*by_reason) for row in turn if row is not None]
    drawn = turns[:DRAWN]
    return Picked(listed=tuple(sorted(_apart(failures, drawn))), drawn=tuple(sorted(drawn)), failures=len(rows))


def _apart(failures: Failures, rows: Sequence[int]) -> list[int]:
    far: list[int] = []
    for row in rows:
        ends = failures.final_m[far] - failures.final_m[row]
        if len(far) < LISTED and np.all(np.hypot(*ends.T) > _APART_M):
            far.append(row)
    near = [row for row in rows if row not in far]
    return [*far, *near][:LISTED]
