"""Rows that cannot be: what no robot could have measured that met its world, by the columns that every batch has.

A gate that counts such rows would judge something else than the robot: an engine that went wrong, a robot that its file
lets through walls, tables that were written by hand. So it judges nothing then, and says which rows they are.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pyarrow as pa

Row = Mapping[str, Any]
_ENDED = "Completed"
_FASTEST_M_S = 20.0
# A robot that is no disc cuts corners, and gets through gaps that a disc of its radius does not.
_SHARE_OF_SHORTEST = 0.5
_SHORTER_M = 1.0
_HAIR = 1e-6
# Of the 13,900 rows of the shipped robots that were looked at, none that passed is below 1.01.
_THROUGH = 0.95
_SHOWN = 3
# Of what is looked at, the columns that older batches have not: their collisions are of all contacts.
_YOUNGER = ("person_contacts", "robot_contacts")


class Impossible(NamedTuple):
    """What cannot be.

    Attributes:
        what: As a sentence has it.
        columns: That it looks at.
        found: Returns whether the row of an episode that came to its end shows it.
    """

    what: str
    columns: tuple[str, ...]
    found: Callable[[Row], bool]


def _all_reached_within(row: Row, share: float) -> bool:
    shortest_m = row["shortest_path_m"]
    passed = row["outcome"] == "Passed" and row["goals_reached"] >= row["goals_total"]
    return passed and shortest_m is not None and row["path_length_m"] < share * shortest_m


def _shortcut(row: Row) -> bool:
    slack_m = _SHORTER_M * row["goals_total"]
    return _all_reached_within(row, _SHARE_OF_SHORTEST) and row["path_length_m"] < row["shortest_path_m"] - slack_m


# A clearance of 0 alone can be: seen from above, a ball leans over an edge lower than its middle and does not touch it.
def _through(row: Row) -> bool:
    contact = row["impulse_ns"] > 0 or row["collisions"] > 0
    return _all_reached_within(row, _THROUGH) and row["min_clearance_m"] <= 0 and not contact


def _pushes_disagree(row: Row) -> bool:
    contacts = row["collisions"] + sum(row.get(name) or 0 for name in _YOUNGER)
    return (row["impulse_ns"] > 0 and not contacts) or row["max_impulse_ns"] > row["impulse_ns"] * (1 + _HAIR)


def _leap(row: Row) -> bool:
    # A simulation that flies apart is a crash, and no verdict of it is false.
    return row["outcome"] == "Passed" and row["path_length_m"] > _FASTEST_M_S * row["simulated_s"] + _HAIR


def _too_many_goals(row: Row) -> bool:
    return row["goals_reached"] > row["goals_total"]


IMPOSSIBLE: tuple[Impossible, ...] = (
    Impossible(
        "passed on less than half of the shortest way",
        ("outcome", "goals_reached", "goals_total", "path_length_m", "shortest_path_m"),
        _shortcut,
    ),
    Impossible(
        "a clearance of 0, no push, and a way shorter than the shortest",
        ("min_clearance_m", "impulse_ns", "collisions"),
        _through,
    ),
    Impossible(
        "a push without a collision, or one larger than all together",
        ("collisions", *_YOUNGER, "impulse_ns", "max_impulse_ns"),
        _pushes_disagree,
    ),
    Impossible(
        f"passed at more than {_FASTEST_M_S:g} m/s in the mean", ("outcome", "path_length_m", "simulated_s"), _leap
    ),
    Impossible("more goals reached than there are", ("goals_reached", "goals_total"), _too_many_goals),
)
"""The list; docs/guide/gate.md says it in words."""

IMPOSSIBLE_COLUMNS = tuple(
    dict.fromkeys(["status", "index", "world", *(name for each in IMPOSSIBLE for name in each.columns)])
)
"""What a gate reads of the results, whatever it asks for."""


def impossible_rows(rows: "pa.Table") -> str:
    """Returns how many rows cannot be, why, and which they are; empty if there are none, or if that cannot be said."""
    there = [name for name in IMPOSSIBLE_COLUMNS if name in rows.column_names]
    if not {*IMPOSSIBLE_COLUMNS} - {*there} <= {*_YOUNGER}:
        return ""
    given = rows.select(there).to_pylist()
    return "; ".join(_lines([row for row in given if row["status"] == _ENDED], len(given)))


def _lines(ended: list[dict[str, Any]], total: int) -> Iterator[str]:
    for each in IMPOSSIBLE:
        found = [row for row in ended if each.found(row)]
        if found:
            where = ", ".join(f"{row['index']} in {row['world']}" for row in found[:_SHOWN])
            more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
            yield f"{len(found)} of {total} rows cannot be: {each.what} (episodes {where}{more})"
