"""Groups: pieces that are placed together, in one frame, because people use them together.

The frame is that of the first member: x along its back, y to its front, its middle at (0, 0).
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from tasks.worlds.furniture.furniture_type import Anchor, Taste, TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box, bounding_box


class Member(NamedTuple):
    """One piece of a group.

    Attributes:
        at: Its middle in the group's frame.
        quarter: Which way it faces there, in quarter turns from +y, counter-clockwise.
        askew: How far it is turned beyond that (radians).
        needed: Whether the group is no group without it.
        worth: How much a place that has room for it is better than one that has not.
        under: How far its front is pushed under something of its group (metres).
    """

    kind: TypeName
    size: Size
    at: tuple[float, float] = (0.0, 0.0)
    quarter: int = 0
    askew: float = 0.0
    needed: bool = True
    worth: float = 1.0
    under: float = 0.0

    @property
    def covers(self) -> float:
        """Floor that it covers and nothing else of its group does (square metres)."""
        return self.size[0] * (self.size[1] - self.under)

    @property
    def body(self) -> Box:
        """The box around it in the group's frame."""
        half_x, half_y = self.size[0] / 2, self.size[1] / 2
        if self.askew:
            cos, sin = abs(math.cos(self.askew)), abs(math.sin(self.askew))
            half_x, half_y = half_x * cos + half_y * sin, half_x * sin + half_y * cos
        if self.quarter % 2:
            half_x, half_y = half_y, half_x
        return Box(self.at[0] - half_x, self.at[1] - half_y, self.at[0] + half_x, self.at[1] + half_y)


class Zone(NamedTuple):
    """Floor that is kept free of other groups for using one; ``member`` is the one that it belongs to."""

    box: Box
    member: int = 0


@dataclass
class FurnitureGroup:
    """Pieces and the floor that their use needs.

    Attributes:
        members: The first stands where the anchor says; the others stand as they lie in its frame.
        anchor: Where it stands; a corner is behind and on the left of the first member.
        quarters: Which ways the first member may face in the room.
        flush: Whether it touches what stands beside it, or keeps a hand's breadth away.
        walls_only: Whether it stays away from the lines in the middle of large rooms.
        needed: Which members it cannot do without.
        area: Floor that those cover (square metres).
    """

    members: tuple[Member, ...]
    zones: tuple[Zone, ...]
    anchor: Anchor = "wall"
    taste: Taste = field(default_factory=Taste)
    quarters: tuple[int, ...] = (0, 1, 2, 3)
    flush: bool = False
    walls_only: bool = False
    needed: list[int] = field(init=False)
    area: float = field(init=False)

    def __post_init__(self) -> None:
        self.needed = [number for number, member in enumerate(self.members) if member.needed]
        self.area = sum([self.members[number].covers for number in self.needed])

    @cached_property
    def bodies(self) -> list[Box]:
        """The members' boxes in the group's frame."""
        return [member.body for member in self.members]

    @cached_property
    def reach(self) -> list[Box]:
        """The boxes around the members that it needs, and around all where there are more than one."""
        bodies = self.bodies
        if len(bodies) == 1:
            return bodies
        return [bounding_box([bodies[number] for number in self.needed]), bounding_box(bodies)]

    def turned(self, quarter: int) -> list[Box]:
        """Returns the members' boxes, then the zones', when it faces some way, in quarter turns counter-clockwise."""
        return [turn_box(box, quarter) for box in (*self.bodies, *[zone.box for zone in self.zones])]


def turn_box(box: Box, quarter: int) -> Box:
    """Returns a box turned about (0, 0) by quarter turns counter-clockwise, exactly."""
    x_min, y_min, x_max, y_max = box
    if quarter == 0:
        return box
    if quarter == 1:
        return Box(-y_max, x_min, -y_min, x_max)
    return Box(-x_max, -y_max, -x_min, -y_min) if quarter == 2 else Box(y_min, -x_max, y_max, -x_min)


def front_zone(size: Size, depth_m: float, aside_m: float = 0.0) -> Zone:
    """Returns the floor before a first member, as wide as it is or wider on both sides."""
    x = size[0] / 2 + aside_m
    return Zone(Box(-x, size[1] / 2, x, size[1] / 2 + depth_m))
