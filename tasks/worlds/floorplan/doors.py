"""Hinged doors (templates of version 2): where each leaf hangs, and how it stands.

A leaf hangs at the face of the wall in the room that it opens into, so that nothing of it meets the wall at any
opening. Which room and which jamb is chosen for all doors of a plan together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from specs.data.world import Color, Door, Passage, Solid
from tasks.worlds.floorplan.floorplan import FloorPlan
from tasks.worlds.floorplan.passages import HUBS, START_CLEAR_M, Gap
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.geometry import QUARTER_TURN_RAD, Box, rounded
from tasks.worlds.resolved_template import ResolvedTemplate

LEAF_THICKNESS_M = 0.04
LEAF_PLAY_M = 0.01
_LEAF_TOP_M = 2.09
_LEAF_COLORS: tuple[Color, ...] = ((0.93, 0.92, 0.9), (0.66, 0.49, 0.33), (0.45, 0.31, 0.2), (0.55, 0.62, 0.66))
# What stands against a way to hang a door. A leaf in the start's clear metre would break a guarantee at some opening.
_IN_START, _IN_WALL, _IN_LEAF, _IN_WAY, _OUT_OF_CORNER, _PUBLIC = 1e4, 1e3, 100.0, 30.0, 1.0, 0.5
_SWEEPS = 4
# Angles in a document are rounded to a millionth.
_ROUNDED_RAD = 1e-5


@dataclass(frozen=True)
class Hanging:
    """A way to hang a leaf.

    Attributes:
        passage: Index of its gap in the plan.
        room: Index of the room that it opens into.
        hinge: Where its axis stands.
        closed_yaw: Where the leaf points from the hinge when it is shut; a multiple of a quarter turn.
        turn: +1 when it opens counter-clockwise, seen from above, else -1.
        length: Extent of the leaf from hinge to tip (metres).
        swing: The floor that the leaf sweeps, as a box.
    """

    passage: int
    room: int
    hinge: tuple[float, float]
    closed_yaw: float
    turn: Literal[1, -1]
    length: float
    swing: Box

    def leaf(self, name: str, percent: float, color: Color) -> Solid:
        """Returns the leaf at an opening of 0 to 100 percent of a quarter turn."""
        angle = self.closed_yaw + self.turn * QUARTER_TURN_RAD * percent / 100.0
        along = (math.cos(angle), math.sin(angle))
        aside = (self.turn * along[1], -self.turn * along[0])
        x, y = (
            self.hinge[axis] + along[axis] * self.length / 2 + aside[axis] * LEAF_THICKNESS_M / 2 for axis in (0, 1)
        )
        half = (self.length / 2, LEAF_THICKNESS_M / 2)
        quarters = round(angle / QUARTER_TURN_RAD)
        straight = abs(angle - quarters * QUARTER_TURN_RAD) < _ROUNDED_RAD
        if straight and quarters % 2:
            half = half[::-1]
        return Solid(
            name=name,
            shape="box",
            center_m=(rounded(x), rounded(y), rounded((LEAF_PLAY_M + _LEAF_TOP_M) / 2)),
            half_extents_m=(rounded(half[0]), rounded(half[1]), rounded((_LEAF_TOP_M - LEAF_PLAY_M) / 2)),
            yaw_rad=0.0 if straight else rounded(math.remainder(angle, 4 * QUARTER_TURN_RAD)),
            color=color,
        )


def build_doors(resolved: ResolvedTemplate, plan: FloorPlan, rng: np.random.Generator) -> tuple[Door, ...]:
    """Returns the doors of one interior as they stand; none for a template whose doorways have no doors.

    Args:
        resolved: What the template asks for.
        plan: The floor plan; its doors hang the same way in each of its interiors.
        rng: Decides colours, and openings that are left to chance.
    """
    if resolved.doors is None:
        return ()
    color = _LEAF_COLORS[int(rng.integers(len(_LEAF_COLORS)))]
    doors: list[Door] = []
    for number, hanging in enumerate(hang_doors(resolved, plan), start=1):
        drawn = round(100.0 * float(rng.random()), 1)
        opening = resolved.doors.opening(plan.gaps[hanging.passage].rooms)
        percent = drawn if opening == "Random" else opening
        name = f"door_{number}"
        doors.append(
            Door(
                name=name,
                passage=hanging.passage,
                opens_into=resolved.rooms[hanging.room].name,
                hinge_m=(rounded(hanging.hinge[0]), rounded(hanging.hinge[1])),
                closed_yaw_rad=rounded(hanging.closed_yaw),
                open_yaw_rad=rounded(
                    math.remainder(hanging.closed_yaw + hanging.turn * QUARTER_TURN_RAD, 4 * QUARTER_TURN_RAD)
                ),
                open_percent=percent,
                leaf=hanging.leaf(name, percent, color),
            )
        )
    return tuple(doors)


def open_leaves(doors: Sequence[Door], passages: Sequence[Passage]) -> tuple[Solid, ...]:
    """Returns the leaves of doors as they stand when all of them are fully open."""
    return tuple(
        door.leaf
        if door.open_percent == 100.0
        else _read_hanging(door, passages[door.passage]).leaf(door.name, 100.0, door.leaf.color)
        for door in doors
    )


@lru_cache(maxsize=64)
def hang_doors(resolved: ResolvedTemplate, plan: FloorPlan) -> tuple[Hanging, ...]:
    """Returns how the doors of a plan hang, one for each doorway; none where the template wants none."""
    if resolved.doors is None:
        return ()
    ways = [_ways(plan, number) for number, gap in enumerate(plan.gaps) if gap.kind == "Doorway"]
    chosen = [min(each, key=lambda way: _cost(resolved, plan, way, ())) for each in ways]
    for _ in range(_SWEEPS):
        for place, each in enumerate(ways):
            others = [*chosen[:place], *chosen[place + 1 :]]
            chosen[place] = min(each, key=lambda way: _cost(resolved, plan, way, others))
    return tuple(chosen)


def _ways(plan: FloorPlan, number: int) -> list[Hanging]:
    """Returns the four ways to hang a leaf: into either room, at either jamb."""
    gap = plan.gaps[number]
    across = 1 if gap.along == "x" else 0
    sides = {room: 1 if plan.cells[room].center[across] > gap.center[across] else -1 for room in gap.rooms}
    return [_way(gap, number, room, side, end) for room, side in sides.items() for end in (-1, 1)]


def _way(gap: Gap, number: int, room: int, side: int, end: int) -> Hanging:
    length = gap.width - 2 * LEAF_PLAY_M
    along, across = (0, 1) if gap.along == "x" else (1, 0)
    hinge, tip = [0.0, 0.0], [0.0, 0.0]
    hinge[along], hinge[across] = gap.center[along] + end * length / 2, gap.center[across] + side * WALL_M / 2
    tip[along], tip[across] = gap.center[along] - end * length / 2, hinge[across] + side * length
    # A wall along x seen from above: a leaf hinged at its lower end that opens upwards turns counter-clockwise.
    turn = -end * side if gap.along == "x" else end * side
    closed = (0.0 if end < 0 else 2 * QUARTER_TURN_RAD) if gap.along == "x" else -end * QUARTER_TURN_RAD
    swing = Box(min(hinge[0], tip[0]), min(hinge[1], tip[1]), max(hinge[0], tip[0]), max(hinge[1], tip[1]))
    return Hanging(number, room, (hinge[0], hinge[1]), closed, 1 if turn > 0 else -1, length, swing)


def _cost(resolved: ResolvedTemplate, plan: FloorPlan, way: Hanging, others: Sequence[Hanging]) -> float:
    """Returns what stands against a way to hang a door, given how the others hang."""
    swing, floor = way.swing, plan.floors[way.room]
    start = (max(swing.x_min, -swing.x_max, 0.0), max(swing.y_min, -swing.y_max, 0.0))
    ways_through = [gap.box(0.5) for number, gap in enumerate(plan.gaps) if number != way.passage]
    corner = (
        min(way.hinge[0] - floor.x_min, floor.x_max - way.hinge[0])
        if plan.gaps[way.passage].along == "x"
        else min(way.hinge[1] - floor.y_min, floor.y_max - way.hinge[1])
    )
    inside = floor.grown(1e-3)
    leaves = inside.x_min <= swing.x_min and inside.y_min <= swing.y_min
    leaves = leaves and swing.x_max <= inside.x_max and swing.y_max <= inside.y_max
    return (
        _IN_START * (math.hypot(*start) < START_CLEAR_M)
        + _IN_WALL * (not leaves)
        + _IN_LEAF * sum(swing.meets(other.swing) for other in others)
        + _IN_WAY * sum(swing.meets(box) for box in ways_through)
        + _OUT_OF_CORNER * min(corner, 2.0)
        - _PUBLIC * HUBS[resolved.rooms[way.room].type]
    )


def _read_hanging(door: Door, passage: Passage) -> Hanging:
    """Returns how a finished door hangs."""
    quarter = math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 4 * QUARTER_TURN_RAD)
    length = passage.width_m - 2 * LEAF_PLAY_M
    nowhere = Box(*door.hinge_m, *door.hinge_m)
    return Hanging(door.passage, -1, door.hinge_m, door.closed_yaw_rad, 1 if quarter > 0 else -1, length, nowhere)
