"""Tells which episodes of two versions are the same, and what each of them came to."""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pyarrow as pa

_SAME = ("simulation_digest", "simulation_package", "simulation_launch_file", "duration_s")
_ASKED = ("world", "seed", "environment")
_ENDED = ("status", "failure_code", "success")
PAIRED_COLUMNS = (*_ASKED, *_SAME, "robot_digest", *_ENDED)


class Drive(NamedTuple):
    """What an episode came to.

    Attributes:
        world: What tells its world apart.
        success: Whether it passed; None for one that was canceled.
        status: RoboMaker's job status.
        failure_code: RoboMaker's failure code, or empty.
    """

    world: str
    success: bool | None
    status: str
    failure_code: str


Drives = Mapping[Hashable, Drive]


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


def drives(table: "pa.Table", worlds: Mapping[str, str], digests: Iterable[str]) -> dict[Hashable, Drive]:
    """Returns what episodes came to, by what was asked of them but for the robot application.

    World, seed, scenario, variables and duration make the same episode; a world by what is in it, not by its name, so
    that worlds that were generated again are the same ones.

    Args:
        table: Rows with the columns ``PAIRED_COLUMNS``, in the order of their indices.
        worlds: What tells worlds apart, by ``<generation>/<world>``.
        digests: Robot applications whose episodes are meant.
    """
    import pyarrow.compute as pc  # noqa: PLC0415 - `simyard plan` counts pairs without Arrow

    meant = table.filter(pc.field("robot_digest").isin(list(digests)))
    names, ended = meant.column("world").to_pylist(), meant.select(_ENDED).to_pylist()
    keys = episode_keys(meant, worlds, _SAME)
    return {
        key: Drive(worlds.get(name, name), row["success"], row["status"], row["failure_code"])
        for key, name, row in zip(keys, names, ended, strict=True)
    }


def both_ended(new: Drives, other: Drives) -> bool:
    """Returns whether there is an episode that both versions drove to an end."""
    return any(key in other and None not in {each.success, other[key].success} for key, each in new.items())
