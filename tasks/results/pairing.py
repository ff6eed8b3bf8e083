"""Two versions on the same episodes: which of them both have, and where they came to different ends."""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping

import pyarrow as pa

from specs.base import Spec

PAIRED_COLUMNS = (
    "world",
    "seed",
    "simulation_digest",
    "simulation_package",
    "simulation_launch_file",
    "environment",
    "duration_s",
    "robot_digest",
    "success",
)
Outcomes = Mapping[Hashable, bool]


class Pairs(Spec):
    """What two versions came to on the same episodes.

    Attributes:
        n: Episodes that both drove.
        gains: How many of them the new version passed and the other did not.
        losses: How many the other version passed and the new one did not.
        unpaired: Episodes of the new version that the other did not drive.
    """

    n: int
    gains: int
    losses: int
    unpaired: int


def outcomes(table: pa.Table, worlds: Mapping[str, str], digests: Iterable[str]) -> dict[Hashable, bool]:
    """Returns whether episodes passed, by what was asked of them but for the robot application.

    World, seed, scenario, variables and duration make the same episode; a world by what is in it, not by its name, so
    that worlds that were generated again are the same ones. Canceled episodes are left out. Equal requests of one batch
    are told apart by their turn.

    Args:
        table: Rows with the columns ``PAIRED_COLUMNS``, in the order of their indices.
        worlds: SHA-256 of each world's document, by ``<generation>/<world>``.
        digests: Robot applications whose episodes are meant.
    """
    wanted, turns = frozenset(digests), Counter[Hashable]()
    found: dict[Hashable, bool] = {}
    for row in table.select(list(PAIRED_COLUMNS)).to_pylist():
        if row["robot_digest"] not in wanted or row["success"] is None:
            continue
        asked = (
            worlds[row["world"]],
            *(row[name] for name in PAIRED_COLUMNS[1:5]),
            tuple(map(tuple, row["environment"])),
            row["duration_s"],
        )
        turns[asked] += 1
        found[asked, turns[asked]] = row["success"]
    return found


def paired_up(new: Outcomes, other: Outcomes) -> Pairs:
    """Returns how the new version compares with another one on the episodes that both drove."""
    common = [key for key in new if key in other]
    return Pairs(
        n=len(common),
        gains=sum(new[key] and not other[key] for key in common),
        losses=sum(other[key] and not new[key] for key in common),
        unpaired=len(new) - len(common),
    )
