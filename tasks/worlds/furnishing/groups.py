"""Groups: pieces that are placed together, in one frame, because people use them together; and single pieces.

The frame is that of the first member: x along its back, y to its front, its middle at (0, 0).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from specs.data.world import RoomType
from tasks.worlds.furnishing.scene import RoomScene
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import Anchor, Size, Taste, TypeName, Variant
from tasks.worlds.geometry import Box, bounding_box

_HALL_M2 = 50.0
_AROUND_M = 0.45
# Depth of what may stand in a hallway narrower than this, where the way is what matters.
_HALL_DEPTH_M = 0.45
_HALL_WIDE_M = 2.6
_MUCH_SPARE = 0.2


@dataclass
class RoomContext:
    """A room that is being furnished, as the makers of groups see it.

    Attributes:
        rng: The room's own stream.
        room: What the room is for.
        scene: What stands in it.
        listed: The only types that it may hold; None for any.
        spare_m2: How much floor the next group may cover.
    """

    rng: np.random.Generator
    room: RoomType
    scene: RoomScene
    listed: tuple[TypeName, ...] | None
    spare_m2: float

    @cached_property
    def area_m2(self) -> float:
        """The room's floor (square metres)."""
        return self.scene.floor.area

    def allows(self, kind: TypeName) -> bool:
        """Returns whether the room may hold a type."""
        return self.listed is None or kind in self.listed

    def front_m(self, kind: TypeName) -> float:
        """Returns how much floor is kept free before a piece: for its use, and for a robot to pass where people do."""
        front = CATALOGUE[kind].front_m
        return max(front, self.scene.way_m) if front >= 0.5 else front

    def size(self, kind: TypeName, variant: Variant | None = None) -> Size:
        """Returns a size for a piece: of that variant, or of one that is usual in a room of this area."""
        usual = CATALOGUE[kind].usual(self.area_m2)
        return draw_size(self.rng, variant or usual[int(self.rng.integers(len(usual)))])

    def sizes(self, kind: TypeName) -> list[Size]:
        """Returns a size of each usual variant, the one that suits the room best first, then smaller ones.

        Halls and half of the other rooms get the largest that is usual, the rest begin with the one below it.
        """
        usual = CATALOGUE[kind].usual(self.area_m2)
        skipped = int(self.rng.integers(2)) if len(usual) > 1 and self.area_m2 < _HALL_M2 else 0
        return [draw_size(self.rng, variant) for variant in reversed(usual[: len(usual) - skipped])]

    def smallest(self, kind: TypeName) -> Size:
        """Returns the least size of a type."""
        variant = CATALOGUE[kind].variants[0]
        depth = variant.depth_m[0] or variant.width_m[0]
        return variant.width_m[0], depth, variant.height_m[0]

    def chance(self, share: float) -> bool:
        """Returns True in that share of the draws."""
        return float(self.rng.random()) < share


def draw_size(rng: np.random.Generator, variant: Variant) -> Size:
    """Returns a size of a variant, in steps of 5 cm."""
    (widths, depths, heights), (a, b, c) = variant.sizes, rng.random(3).tolist()
    width, depth = widths[int(a * len(widths))], depths[int(b * len(depths))]
    return width, depth or width, heights[int(c * len(heights))]


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


def single_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields one piece in each size to try, and in its least."""
    sizes = setting.sizes(kind)
    if setting.room == "Hallway" and not _wide(setting):
        sizes = [size for size in sizes if size[1] <= _HALL_DEPTH_M] or sizes
    for size in dict.fromkeys([*sizes[:2], setting.smallest(kind)]):
        yield _single(setting, kind, size)


def storage_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields wardrobes for bedrooms, shelving for closets, larders for kitchens, shallow cabinets for the rest."""
    for size in dict.fromkeys(_storage_sizes(setting, kind)):
        yield _single(setting, kind, size)


def _single(setting: RoomContext, kind: TypeName, size: Size) -> FurnitureGroup:
    """Returns a group of one piece."""
    model, members = CATALOGUE[kind], (Member(kind, size),)
    x, y = size[0] / 2, size[1] / 2
    if model.anchor == "center":
        around = max(_AROUND_M, setting.scene.way_m)
        zone = Zone(Box(-x - around, -y - around, x + around, y + around))
        return FurnitureGroup(members, (zone,), model.anchor, model.taste)
    zones = [front_zone(size, setting.front_m(kind))]
    aside = max(model.use_width_m - size[0], 0.0) / 2
    if aside:
        zones.append(Zone(Box(-x - aside, -y, x + aside, y)))
    return FurnitureGroup(members, tuple(zones), model.anchor, model.taste, flush=model.row)


def _storage_sizes(setting: RoomContext, kind: TypeName) -> list[Size]:
    """Returns the sizes to try, the most welcome first, then one that fits nearly everywhere.

    The variants are, in order, a hall cabinet, open shelving, a larder, and wardrobes.
    """
    hall, shelves, larder, *wardrobes = CATALOGUE[kind].usual(setting.area_m2)
    # Open shelving is shallow: a closet that shall be full, or is a hall, is lined with wardrobes first.
    deep = setting.spare_m2 > _MUCH_SPARE * setting.area_m2 or setting.area_m2 > _HALL_M2 or setting.chance(0.5)
    wanted = {
        "Bedroom": [*reversed(wardrobes)],
        "Closet": [*reversed(wardrobes)] if deep else [shelves, wardrobes[0]],
        "Kitchen": [larder],
        "Living": [wardrobes[0], hall],
        "Dining": [hall],
        "Hallway": [wardrobes[0], hall] if _wide(setting) else [hall],
        "Bathroom": [hall],
    }[setting.room]
    if setting.chance(0.4) and len(wanted) > 2:
        wanted = wanted[1:]
    return [setting.size(kind, variant) for variant in (*wanted, larder if setting.room == "Bedroom" else hall)]


def _wide(setting: RoomContext) -> bool:
    floor = setting.scene.floor
    return min(floor.width, floor.height) >= _HALL_WIDE_M
