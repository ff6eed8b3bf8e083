"""Pairs the episodes that two versions drove both, and counts those that came to different ends."""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from specs.base import Spec

if TYPE_CHECKING:
    import pyarrow as pa

_SAME = ("simulation_digest", "simulation_package", "simulation_launch_file", "duration_s")
_ASKED = ("world", "seed", "environment")
PAIRED_COLUMNS = (*_ASKED, *_SAME, "robot_digest", "success")
Outcomes = Mapping[Hashable, bool]


class PairCounts(Spec):
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


def episode_keys(table: "pa.Table", worlds: Mapping[str, str], columns: Sequence[str]) -> list[Hashable]:
    """Returns what makes each row the same episode as a row of another table: world, seed, variables, and columns.

    Equal requests of one table are told apart by their turn.

    Args:
        table: Rows in the order of their indices.
        worlds: What tells worlds apart, by ``<generation>/<world>``; those that it does not have go by their names.
        columns: What else makes an episode the same.
    """
    turns, keys = Counter[Hashable](), list[Hashable]()
    for row in table.select([*_ASKED, *columns]).to_pylist():
        world = worlds.get(row["world"], row["world"])
        asked = (world, row["seed"], tuple(sorted(row["environment"])), *(row[name] for name in columns))
        turns[asked] += 1
        keys.append((asked, turns[asked]))
    return keys


def outcomes(table: "pa.Table", worlds: Mapping[str, str], digests: Iterable[str]) -> dict[Hashable, bool]:
    """Returns whether episodes passed, by what was asked of them but for the robot application.

    World, seed, scenario, variables and duration make the same episode; a world by what is in it, not by its name, so
    that worlds that were generated again are the same ones. Canceled episodes are left out.

    Args:
        table: Rows with the columns ``PAIRED_COLUMNS``, in the order of their indices.
        worlds: What tells worlds apart, by ``<generation>/<world>``.
        digests: Robot applications whose episodes are meant.
    """
    import pyarrow.compute as pc  # noqa: PLC0415 - `simyard plan` counts pairs without Arrow

    meant = table.filter(pc.field("robot_digest").isin(list(digests)))
    passed = meant.column("success").to_pylist()
    keys = episode_keys(meant, worlds, _SAME)
    return {key: success for key, success in zip(keys, passed, strict=True) if success is not None}


def count_pairs(new: Outcomes, other: Outcomes) -> PairCounts:
    """Returns how the new version compares with another one on the episodes that both drove."""
    common = [key for key in new if key in other]
    return PairCounts(
        n=len(common),
        gains=sum(new[key] and not other[key] for key in common),
        losses=sum(other[key] and not new[key] for key in common),
        unpaired=len(new) - len(common),
    )
