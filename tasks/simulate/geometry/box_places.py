"""Where and when boxes stand in an episode: at given places, or drawn somewhere on the robot's way."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int32

from specs.data.boxes import MOST_BOXES, Box
from specs.data.episode import CONTROL_S
from tasks.simulate.application.contract import Placement
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.shortest_path import Ways, shortest_lines

NEVER_STEP = 1 << 30
# Between the robot's hull and a box that appears beside it.
_ROOM_M = 0.05
# Between a box that is drawn and the robot at its start, or at a goal.
_APART_M = 0.1
_DRAWS = 64
# The stream of a seed's noise that places are drawn from; each box has a counter of its own.
_STREAM = 0x626F786573


class BoxesRefused(ValueError):  # noqa: N818 - an episode
    """An episode cannot have the boxes that it asks for."""


class HostBoxes(NamedTuple):
    """The boxes of an episode, before they go to a device; those beyond its own never appear.

    Attributes:
        place_m: Where the middle of each is.
        half_m: Half of its sides, the height last.
        appears: The control step at which each appears.
        leaves: The one at which it is gone.
        touched: Whether it reaches into the hull's band of heights.
        room_m: So far from the middle of the robot it appears.
    """

    place_m: Float32[np.ndarray, "boxes 2"]
    half_m: Float32[np.ndarray, "boxes 3"]
    appears: Int32[np.ndarray, "boxes"]
    leaves: Int32[np.ndarray, "boxes"]
    touched: np.ndarray
    room_m: Float32[np.ndarray, ""]


def host_boxes(asked: Sequence[Box], seed: int, placement: Placement, ways: Ways, hull: Hull) -> HostBoxes:
    """Returns the boxes of an episode, each drawn from its seed, whatever is beside it.

    Args:
        asked: How large they are, and when they are there.
        seed: The episode's.
        placement: Where its robot starts, and its goals.
        ways: Of the robot about the world.
        hull: The robot's.

    Raises:
        BoxesRefused: There is no room on its way for one whose place is to be drawn.
    """
    found = HostBoxes(
        place_m=np.zeros((MOST_BOXES, 2), np.float32),
        half_m=np.full((MOST_BOXES, 3), 0.05, np.float32),
        appears=np.full(MOST_BOXES, NEVER_STEP, np.int32),
        leaves=np.full(MOST_BOXES, NEVER_STEP, np.int32),
        touched=np.zeros(MOST_BOXES, np.bool_),
        room_m=np.asarray(hull.radius_m + _ROOM_M, np.float32),
    )
    way = None
    for number, box in enumerate(asked):
        if box.at_m is None:
            way = _way(placement, ways) if way is None else way
            rng = np.random.Generator(np.random.Philox(key=[seed % (1 << 64), _STREAM], counter=[0, 0, 0, number]))
            found.place_m[number] = _drawn(number, box, way, placement, hull, rng)
        else:
            found.place_m[number] = box.at_m
        found.half_m[number] = np.asarray(box.size_m) / 2
        found.appears[number] = _step(box.appears_s)
        found.leaves[number] = NEVER_STEP if box.leaves_s is None else _step(box.leaves_s)
        found.touched[number] = box.size_m[2] > hull.low_m
    return found


def _step(time_s: float) -> int:
    return min(round(time_s / CONTROL_S), NEVER_STEP)


def _way(placement: Placement, ways: Ways) -> Float64[np.ndarray, "corners 2"]:
    """Returns the shortest way from the start to all goals in order, as far as there is one."""
    stops = np.concatenate([placement.start[None, :2], placement.goals_m]).astype(np.float64)
    corners = [stops[:1]]
    for lines, counts in shortest_lines(ways.graph, stops[None]):
        if counts[0] == 0:
            break
        corners.append(lines[0, : counts[0]])
    return np.concatenate(corners)


def _drawn(  # noqa: PLR0917 - what a place is drawn from
    number: int,
    box: Box,
    way: Float64[np.ndarray, "corners 2"],
    placement: Placement,
    hull: Hull,
    rng: np.random.Generator,
) -> Float64[np.ndarray, "2"]:
    """Returns a place on the way at which a box leaves room for the robot at its start and its goals.

    Raises:
        BoxesRefused: None was found.
    """
    gone_m = np.concatenate([[0.0], np.hypot(*np.diff(way, axis=0).T).cumsum()])
    stops = np.concatenate([placement.start[None, :2], placement.goals_m])
    apart_m = hull.radius_m + np.hypot(box.size_m[0], box.size_m[1]) / 2 + _APART_M
    for along_m in (gone_m[-1] * rng.random(_DRAWS)).tolist():
        place = np.array([np.interp(along_m, gone_m, way[:, axis]) for axis in range(2)])
        if np.hypot(*(stops - place).T).min() >= apart_m:
            return place
    raise BoxesRefused(
        f"boxes: [{number}]: no place on the robot's way is {apart_m:.2f} m from its start and its goals"
    )
