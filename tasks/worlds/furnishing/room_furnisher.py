"""Furnishes one room: places groups of its programme until the density is met, and keeps the ways open."""

from dataclasses import dataclass, field

import numpy as np

from tasks.worlds.brief import RoomWish
from tasks.worlds.furnishing.arrangements import groups_to_try
from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.placement import place_group
from tasks.worlds.furnishing.programme import listed_programme, open_programme
from tasks.worlds.furnishing.room_access import robot_gets_around
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furnishing.scene import PlacedGroup, RoomScene
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.furniture.furniture_type import TypeName
from tasks.worlds.furniture.primitives import Style

_ROUNDS = 12
# A group may miss the wished density by as much as leaving it out would; what makes the room, by more.
_SHARE_WITHIN, _ESSENTIAL_WITHIN = 0.5, 0.55
_NEAR_M2 = 0.12
_OPTIONAL_M2 = 0.3
_LARGE_M2 = 1.5
_MENDS = 4


@dataclass
class _Work:
    """A room at work.

    Attributes:
        target_m2: How much floor shall be covered.
        solids: How many primitives there may still be.
        radius_m: Radius of the robot that shall get around; only groups that are large must prove that it does.
        careful: Whether all of them must.
        hopeless: Types for which there was no place; there will be none later.
    """

    rng: np.random.Generator
    wish: RoomWish
    scene: RoomScene
    style: Style
    target_m2: float
    solids: int
    radius_m: float
    careful: bool
    covered_m2: float = 0.0
    hopeless: set[TypeName] = field(default_factory=set[TypeName])

    @property
    def done(self) -> bool:
        return self.covered_m2 >= self.target_m2 - _NEAR_M2 or self.solids <= 0


def furnish(
    rng: np.random.Generator,
    wish: RoomWish,
    scene: RoomScene,
    style: Style,
    *,
    solids: int,
    density: float,
    radius_m: float,
    careful: bool = False,
) -> bool:
    """Puts furniture into a scene, and returns whether a robot gets around in it.

    Args:
        rng: The room's own stream.
        wish: The room as the template wants it.
        scene: The room; it gets the pieces.
        style: The shapes of its furniture, which decide how many primitives a piece has.
        solids: How many primitives there may be, give or take a group.
        density: Share of the floor to cover, 0-1.
        radius_m: Radius of the robot that shall get around in the room.
        careful: Whether each group must prove that it does; if not, only large ones must.
    """
    if wish.furniture == ():
        return True
    first, rest = (
        open_programme(rng, wish.type) if wish.furniture is None else listed_programme(rng, wish.type, wish.furniture)
    )
    work = _Work(rng, wish, scene, style, density * scene.floor.area, solids, radius_m, careful)
    for kind in first:
        if scene.count(kind) == 0 and not (work.done and scene.pieces):
            _place_first_fit(work, kind, _ESSENTIAL_WITHIN)
    _fill(work, rest)
    if _leaves_open(work, len(scene.groups)):
        return True
    work.careful = True
    mended = _mend(work)
    _fill(work, rest)
    return mended


def _fill(work: _Work, kinds: dict[TypeName, float]) -> None:
    """Adds groups in rounds until the density is met, or a round adds none.

    Args:
        work: The room.
        kinds: What to add, and the floor for which there is one of each.
    """
    scene = work.scene
    for _ in range(_ROUNDS):
        before = len(scene.pieces)
        for kind, spread_m2 in kinds.items():
            if work.done:
                return
            if kind not in work.hopeless and scene.count(kind) < 1 + int(scene.floor.area / spread_m2):
                _place_first_fit(work, kind, _SHARE_WITHIN)
        if len(scene.pieces) == before:
            return


def _place_first_fit(work: _Work, kind: TypeName, within: float) -> None:
    """Places the first group for a type that fits the density and the room."""
    left = work.target_m2 - work.covered_m2
    setting = RoomContext(work.rng, work.wish.type, work.scene, work.wish.furniture, left)
    tried = False
    last: FurnitureGroup | None = None
    for group in groups_to_try(setting, kind):
        last = group
        if within * group.area > left:
            continue
        tried = True
        if _try_group(work, group, left):
            return
    if not work.scene.pieces and last is not None and not tried:
        _try_group(work, last, left)
    elif tried:
        work.hopeless.add(kind)


def _try_group(work: _Work, group: FurnitureGroup, left_m2: float) -> bool:
    care = work.radius_m if work.careful or group.area > _LARGE_M2 else 0.0
    spare = left_m2 - group.area + _OPTIONAL_M2 if group.area <= left_m2 else 0.0
    found = place_group(work.rng, work.scene, group, spare_m2=spare, radius_m=care)
    if found is None:
        return False
    _account(work, found, 1)
    return True


def _mend(work: _Work) -> bool:
    """Takes out the groups that shut a robot out of a part of the room, the earliest that does first."""
    groups = work.scene.groups
    for _ in range(_MENDS):
        low, high = 0, len(groups)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if _leaves_open(work, middle) else (low, middle)
        _account(work, work.scene.remove(high - 1), -1)
        if _leaves_open(work, len(groups)):
            return True
    return False


def _leaves_open(work: _Work, count: int) -> bool:
    """Returns whether a robot gets around when only the first so many groups stand."""
    bodies = [piece.body for group in work.scene.groups[:count] for piece in group.pieces]
    return robot_gets_around(work.scene.floor, bodies, work.scene.entries, work.radius_m)


def _account(work: _Work, group: PlacedGroup, sign: int) -> None:
    work.covered_m2 += sign * sum(piece.covers_m2 for piece in group.pieces)
    work.solids -= sign * sum(len(compose(piece.type, piece.size, work.style)) for piece in group.pieces)
