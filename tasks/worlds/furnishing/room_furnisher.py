"""Furnishes one room: places groups of its programme until the density is met, and keeps the ways open."""

from dataclasses import dataclass, field

import numpy as np

from tasks.worlds.brief import RoomWish
from tasks.worlds.furnishing.arrangements import arrangements
from tasks.worlds.furnishing.groups.group import Group
from tasks.worlds.furnishing.placement import place
from tasks.worlds.furnishing.programme import listed_programme, open_programme
from tasks.worlds.furnishing.room_access import ways_open
from tasks.worlds.furnishing.room_context import Setting
from tasks.worlds.furnishing.scene import Placed, Scene
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
    scene: Scene
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
    scene: Scene,
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
            _put(work, kind, _ESSENTIAL_WITHIN)
    _fill(work, rest)
    if _open(work, len(scene.groups)):
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
                _put(work, kind, _SHARE_WITHIN)
        if len(scene.pieces) == before:
            return


def _put(work: _Work, kind: TypeName, within: float) -> None:
    """Places the first group for a type that fits the density and the room."""
    left = work.target_m2 - work.covered_m2
    setting = Setting(work.rng, work.wish.type, work.scene, work.wish.furniture, left)
    tried = False
    last: Group | None = None
    for group in arrangements(setting, kind):
        last = group
        if within * group.area > left:
            continue
        tried = True
        if _placed(work, group, left):
            return
    if not work.scene.pieces and last is not None and not tried:
        _placed(work, last, left)
    elif tried:
        work.hopeless.add(kind)


def _placed(work: _Work, group: Group, left_m2: float) -> bool:
    care = work.radius_m if work.careful or group.area > _LARGE_M2 else 0.0
    spare = left_m2 - group.area + _OPTIONAL_M2 if group.area <= left_m2 else 0.0
    found = place(work.rng, work.scene, group, spare_m2=spare, radius_m=care)
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
            low, high = (middle, high) if _open(work, middle) else (low, middle)
        _account(work, work.scene.remove(high - 1), -1)
        if _open(work, len(groups)):
            return True
    return False


def _open(work: _Work, count: int) -> bool:
    """Returns whether a robot gets around when only the first so many groups stand."""
    bodies = [piece.body for group in work.scene.groups[:count] for piece in group.pieces]
    return ways_open(work.scene.floor, bodies, work.scene.entries, work.radius_m)


def _account(work: _Work, group: Placed, sign: int) -> None:
    work.covered_m2 += sign * sum(piece.covers_m2 for piece in group.pieces)
    work.solids -= sign * sum(len(compose(piece.type, piece.size, work.style)) for piece in group.pieces)
