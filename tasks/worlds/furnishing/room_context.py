"""What a group is made for: a room of a type, its area, what it may hold, and the stream that draws."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from specs.data.world import RoomType
from tasks.worlds.furnishing.scene import RoomScene
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import TypeName, Variant
from tasks.worlds.furniture.primitives import Size

_HALL_M2 = 50.0


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
