"""Finds the room in which each episode started and ended."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.world import Room, World
from tasks.results.report.batch_columns import Episodes, Labels

BETWEEN = "between rooms"
UNKNOWN = "not known"


@dataclass(frozen=True)
class Worlds:
    """A batch's worlds, as far as they can be read.

    Attributes:
        rooms: The rooms of each, by ``<generation>/<name>``.
        load: Gives all of one of them; a batch has too many to hold them all.
    """

    rooms: Mapping[str, Sequence[Room]]
    load: Callable[[str], World]


def start_rooms(episodes: Episodes, worlds: Worlds) -> Labels:
    """Returns the type of the room that each episode starts in: the one around the origin."""
    rooms = worlds.rooms
    kinds = [_room_types(rooms[name], np.zeros((1, 2)))[0] if name in rooms else UNKNOWN for name in _names(episodes)]
    return _as_labels(np.array(kinds, object)[episodes.world.codes])


def end_rooms(episodes: Episodes, worlds: Worlds) -> Labels:
    """Returns the type of the room that each episode ended in; a doorway belongs to none."""
    found = np.full(len(episodes.outcome), UNKNOWN, object)
    order = np.argsort(episodes.world.codes, kind="stable")
    counts = np.bincount(episodes.world.codes, minlength=len(_names(episodes)))
    for name, end, count in zip(_names(episodes), np.cumsum(counts), counts, strict=True):
        rows = order[end - count : end]
        if name in worlds.rooms:
            found[rows] = _room_types(worlds.rooms[name], episodes.final_m[rows])
    return _as_labels(found)


def _names(episodes: Episodes) -> tuple[str, ...]:
    return episodes.world.names


def _room_types(rooms: Sequence[Room], points_m: Float[np.ndarray, "points 2"]) -> np.ndarray:
    found = np.full(len(points_m), BETWEEN, object)
    for room in rooms:
        floor = room.floor
        inside: Bool[np.ndarray, " points"] = np.all(
            (points_m >= (floor.x_min_m, floor.y_min_m)) & (points_m <= (floor.x_max_m, floor.y_max_m)), axis=1
        )
        found[inside] = room.type
    return found


def _as_labels(names: np.ndarray) -> Labels:
    known, codes = np.unique(names.astype(str), return_inverse=True)
    kept: Int[np.ndarray, " rows"] = codes.astype(np.int64)
    return Labels(tuple(str(name) for name in known), kept)
