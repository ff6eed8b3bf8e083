"""How long a tour along shortest lines is, when each goal counts as reached from near: corners are cut there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.simulate.surroundings.ways.open_floor import OpenFloor, has_room, is_open
from tasks.simulate.surroundings.ways.visibility import Points

# Places on the rim of a goal's disc that a way may bend at.
_RIM = 24
_RIM_RAD = 2 * np.pi * np.arange(_RIM) / _RIM
RIM_UNITS = np.stack([np.cos(_RIM_RAD), np.sin(_RIM_RAD)], axis=-1)
# Of the places that a way may bend at, so many of the best are looked at together.
_BEST = (2, 8, _RIM + 2)
# NumPy adds up fewer numbers one after the other.
_FEW = 8
# Longer than any way: of a place that a way should bend at only if it cannot bend elsewhere.
_LAST_M = 1e9
Metres = Float64[np.ndarray, "tasks"]


class Lines(NamedTuple):
    """Lines, one for each task.

    Attributes:
        corners_m: Where each begins, bends and ends; the end again where it has fewer corners than others.
        counts: How many corners it has, begin and end included; 0 where there is no line.
    """

    corners_m: Float64[np.ndarray, "tasks corners 2"]
    counts: Int[np.ndarray, "tasks"]


def tour_lengths(
    floor: OpenFloor,
    stops: Float64[np.ndarray, "tasks stops 2"],
    near_m: Float64[np.ndarray, "tasks stops"],
    legs: Sequence[Lines],
) -> Metres:
    """Returns how long the tours are.

    Args:
        floor: Where the disc has room.
        stops: Start and goals of each task.
        near_m: From how far each counts as reached.
        legs: The shortest lines from stop to stop.
    """
    total, line = np.zeros(len(stops)), legs[0]
    for stop, leg in enumerate(legs[1:], start=1):
        driven, end, _ = _until_near(line, stops[:, stop], near_m[:, stop])
        total += driven
        onward = _first_beyond(leg, stops[:, stop], near_m[:, stop])
        here = _bends(floor, end, onward.corners_m[:, 0], stops[:, stop], near_m[:, stop])
        total += np.hypot(*(here - end).T)
        line = Lines(np.concatenate([here[:, None], onward.corners_m], axis=1), onward.counts + 1)
    driven, _, rest = _until_near(line, stops[:, -1], near_m[:, -1])
    return total + (driven + rest)


def _until_near(line: Lines, goals: Points, near_m: Metres) -> tuple[Metres, Points, Metres]:
    """Returns a line's length to its last corner before it comes near a goal, that corner, and what is left to go."""
    tasks = np.arange(len(goals))
    begins = line.corners_m[:, :-1]
    way = np.diff(line.corners_m, axis=1)
    length = np.hypot(way[..., 0], way[..., 1])
    unit = way / np.maximum(length, 1e-12)[..., None]
    to_goal = goals[:, None] - begins
    along = np.sum(to_goal * unit, axis=2)
    across = to_goal[..., 0] * unit[..., 1] - to_goal[..., 1] * unit[..., 0]
    near = near_m[:, None]
    half_chord = np.sqrt(np.maximum(near**2 - across**2, 0.0))
    enters = (np.abs(across) <= near) & (along + half_chord >= 0.0) & (along - half_chord <= length)
    enters[tasks, line.counts - 2] = True
    first = np.argmax(enters, axis=1)
    rest = np.clip((along - half_chord)[tasks, first], 0.0, length[tasks, first])
    return _sum_of_first(length, first), begins[tasks, first], rest


def _sum_of_first(length: Float64[np.ndarray, "tasks corners"], count: Int[np.ndarray, "tasks"]) -> Metres:
    """Returns the sums of each row's first numbers, the bits that NumPy's sum of them has."""
    sums = np.concatenate([np.zeros((len(length), 1)), np.cumsum(length[:, : _FEW - 1], axis=1)], axis=1)
    found = sums[np.arange(len(length)), np.minimum(count, sums.shape[1] - 1)]
    for task in np.flatnonzero(count >= _FEW):
        found[task] = length[task, : count[task]].sum()
    return found


def _first_beyond(line: Lines, goals: Points, near_m: Metres) -> Lines:
    """Returns what follows of a line after its corners near a goal; at least its end."""
    away = line.corners_m - goals[:, None]
    far = np.hypot(away[..., 0], away[..., 1]) > near_m[:, None]
    far[np.arange(len(goals)), line.counts - 1] = True
    first = np.argmax(far, axis=1)
    kept = np.minimum(first[:, None] + np.arange(line.corners_m.shape[1]), line.counts[:, None] - 1)
    return Lines(np.take_along_axis(line.corners_m, kept[..., None], axis=1), line.counts - first)


def _bends(floor: OpenFloor, before: Points, after: Points, goals: Points, near_m: Metres) -> Points:
    """Returns where a way between two corners best touches its goal's disc; the goal itself where all else is shut."""
    way = after - before
    share = np.sum((goals - before) * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-12)
    passing = before + np.clip(share, 0.0, 1.0)[:, None] * way
    beside = passing - goals
    beside *= np.minimum(1.0, near_m / np.maximum(np.hypot(*beside.T), 1e-12))[:, None]
    rim = goals[:, None] + near_m[:, None, None] * RIM_UNITS
    places = np.concatenate([rim, (goals + beside)[:, None], goals[:, None]], axis=1)
    lengths = np.hypot(*np.moveaxis(places - before[:, None], -1, 0)) + np.hypot(
        *np.moveaxis(places - after[:, None], -1, 0)
    )
    order = np.argsort(lengths, axis=1, kind="stable")
    chosen = np.full(len(places), places.shape[1] - 1)
    left, first = np.arange(len(places)), 0
    for last in _BEST:
        open_ = _can_bend(floor, before[left], after[left], places[left[:, None], order[left, first:last]])
        found = open_.any(axis=1)
        chosen[left[found]] = order[left[found], first + np.argmax(open_[found], axis=1)]
        left, first = left[~found], last
    return places[np.arange(len(places)), chosen]


def _can_bend(
    floor: OpenFloor, before: Points, after: Points, places: Float64[np.ndarray, "tasks places 2"]
) -> Bool[np.ndarray, "tasks places"]:
    """Returns whether the disc has room at places, and straight ways from the one corner and to the other."""
    each, flat = places.shape[1], places.reshape(-1, 2)
    free = has_room(floor, flat)
    for corner in (before, after):
        free[free] = is_open(floor, flat[free], np.repeat(corner, each, axis=0)[free])
    return free.reshape(places.shape[:2])
