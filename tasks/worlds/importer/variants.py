"""Variants of a building of one's own: pieces moved, taken out and added, and certified for a robot.

A robot of the given radius gets about in each, and to nine tenths of what it got to before, but for what the pieces
themselves take, so that a rate over variants speaks of buildings like this one. Same world, seed and wishes: same
variants, in any order.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from specs.data.world import Color, Furniture, Solid, World, corners_m, start_pose
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.geometry import HEADROOM_M, rounded
from tasks.worlds.importer.own_floor import cell_at, largest_radius_m, measured, own_floor, reached_from
from tasks.worlds.streams import variant_stream
from tasks.worlds.survey import ExactGrid

VARIATION = "simyard-variants-1"
"""Changes whenever the same world, seed and wishes would give other variants."""
KEPT_SHARE = 0.9
"""So much of the floor that the robot got to before it gets to in a variant, beside what new and moved pieces take."""
_TRIES = 20
_PIECE_TRIES = 12
# Longer than this it is no piece that somebody moves: a wall, a counter, a rack that is bolted down.
_MOST_LENGTH_M = 4.0
# A piece that begins higher hangs.
_STANDS_M = 0.1
# Solids that go into each other by more than this belong together: what stands on a table, a chair of several models.
_JOINED_M = 0.03
_TOUCH_M = 1e-4
_MOST_TURN_RAD = math.pi / 12
# Nothing is put nearer to the start, on top of the robot's radius.
_FREE_START_M = 0.5
_CARDBOARD: Color = (0.72, 0.56, 0.38)
_WOOD: Color = (0.6, 0.45, 0.28)
_PALLET_HALF_M = (0.6, 0.4, 0.072)


@dataclass(frozen=True)
class VariantWishes:
    """What variants of a world differ in.

    Attributes:
        move_m: How far a piece is moved at most; it turns by up to 15 degrees, less if it is long.
        remove: Share of the pieces that is taken out, 0-1.
        clutter: How many boxes and pallets are put on the floor.
        radius_m: Of the robot that is to get about, at most 1.
    """

    move_m: float = 0.0
    remove: float = 0.0
    clutter: int = 0
    radius_m: float = 0.25


class _Outline(NamedTuple):
    """A solid from above, and between which heights: corners in order, a circle as a polygon around it."""

    corners: Float[np.ndarray, "corners 2"]
    low_m: float
    high_m: float


Outlines = Sequence[_Outline]


class _Crowd:
    """Outlines that nothing may go into, those near a thing found quickly."""

    def __init__(self, outlines: Outlines) -> None:
        self._outlines = list(outlines)
        self._boxes = np.array([_bounds([each]) for each in outlines]).reshape(-1, 4)

    def add(self, outlines: Outlines) -> None:
        """Lets more things stand there."""
        self._outlines += outlines
        self._boxes = np.concatenate([self._boxes, np.array([_bounds([each]) for each in outlines]).reshape(-1, 4)])

    def hits(self, outlines: Outlines) -> bool:
        """Returns whether one of some things goes into one that stands there."""
        for one in outlines:
            low_x, low_y, high_x, high_y = _bounds([one])
            boxes = self._boxes.T
            near = (boxes[0] < high_x) & (boxes[1] < high_y) & (boxes[2] > low_x) & (boxes[3] > low_y)
            if any(_depth_m(one, self._outlines[number]) > _TOUCH_M for number in np.flatnonzero(near).tolist()):
                return True
        return False


class _Building(NamedTuple):
    """A world as it was imported, and what all its variants are made with.

    Attributes:
        grid: Its floor.
        reached: What of it the robot gets to.
        groups: The pieces that can be moved, those together that go into each other.
    """

    world: World
    grid: ExactGrid
    reached: Bool[np.ndarray, "x y"]
    groups: list[list[int]]


def vary_worlds(world: World, seed: int, variants: Iterable[int], wishes: VariantWishes) -> Iterator[World]:
    """Yields variants of an imported world, measured and certified.

    Args:
        world: As it was imported.
        seed: At least 0.
        variants: Their numbers, from 1; each has a random stream of its own.
        wishes: What to change.

    Raises:
        WorldRejected: InvalidInput, where the robot does not get about in the world as it is, or no try leaves it
            its floor.
    """
    grid, start = own_floor(world), start_pose(world)
    reached = reached_from(grid, start, wishes.radius_m)
    if not reached.any():
        raise WorldRejected(
            "InvalidInput", f"{world.name}: a robot of {wishes.radius_m:g} m radius has no room at the start"
        )
    if (most_m := largest_radius_m(grid, start)) < wishes.radius_m:
        raise WorldRejected(
            "InvalidInput",
            f"{world.name}: a robot of {wishes.radius_m:g} m radius does not get about in it as it is, only one of up "
            f"to {most_m:g} m: robotRadius says whom variants are for",
        )
    building = _Building(world, grid, reached, _groups(world))
    yield from (_variant(building, seed, number, wishes) for number in variants)


def _variant(building: _Building, seed: int, number: int, wishes: VariantWishes) -> World:
    """Returns the first try that leaves the robot its floor."""
    world = building.world
    for sub_seed in range(_TRIES):
        furniture = _changed(building, wishes, variant_stream(seed, number, sub_seed))
        changed = world.model_copy(
            update={
                "name": f"{world.name}-{number}",
                "generation": _generation(world, seed, wishes),
                "seed": seed,
                "sub_seed": sub_seed,
                "interior_index": number,
                "furniture": furniture,
            }
        )
        if _keeps(changed, wishes.radius_m, building.reached):
            made = measured(changed, wishes.radius_m)
            if made.certificate.reachable_robot_radius_m >= wishes.radius_m:
                return made
    raise WorldRejected(
        "InvalidInput",
        f"{world.name}, variant {number}: tried {_TRIES} times; a robot of {wishes.radius_m:g} m radius keeps less "
        f"than {KEPT_SHARE:.0%} of the floor, or loses a route's place or a room: ask for less clutter, shorter moves",
    )


def _generation(world: World, seed: int, wishes: VariantWishes) -> str:
    """Returns what the folder of variants is called: those of more are the same, and more."""
    made_of = f"{VARIATION} {world.generation} {world.name} {seed} {wishes}"
    return f"variants-{hashlib.sha256(made_of.encode()).hexdigest()[:16]}"


def _keeps(world: World, radius_m: float, reached: Bool[np.ndarray, "x y"]) -> bool:
    """Returns whether a robot gets to what it got to before, to all places of routes and into all zones too."""
    grid = own_floor(world)
    still = reached_from(grid, start_pose(world), radius_m)
    left = reached & grid.free(radius_m)
    places = [cell_at(grid, place) for route in world.routes or () for place in route.points_m]
    lost = any(cell is not None and reached[cell] and not still[cell] for cell in places)
    cells = np.nonzero(reached)
    x_m, y_m = (middles[each] for middles, each in zip(grid.centers_m, cells, strict=True))
    there, held = still[cells], (zone.holds(x_m, y_m) for zone in world.zones or ())
    lost = lost or any(within.any() and not there[within].any() for within in held)
    kept = int(np.count_nonzero(still & reached))
    return not lost and kept >= max(1.0, KEPT_SHARE * int(np.count_nonzero(left)))


def _changed(building: _Building, wishes: VariantWishes, rng: np.random.Generator) -> tuple[Furniture, ...]:
    """Returns the pieces of a variant, those that stay in the world's order."""
    world, groups = building.world, building.groups
    gone = {number for group in groups if rng.random() < wishes.remove for number in group}
    pieces = {number: piece for number, piece in enumerate(world.furniture) if number not in gone}
    fixed = [_outline(wall) for wall in world.walls]
    outlines = {number: _outlines(piece) for number, piece in pieces.items()}
    for group in groups:
        left = [number for number in group if number in pieces]
        if left and wishes.move_m > 0.0:
            others = [each for number, some in outlines.items() if number not in left for each in some]
            moved = _moved([pieces[number] for number in left], wishes, rng, _Crowd([*fixed, *others]), world)
            pieces |= dict(zip(left, moved, strict=True))
            outlines |= {number: _outlines(pieces[number]) for number in left}
    crowd = _Crowd([*fixed, *(each for some in outlines.values() for each in some)])
    return (*pieces.values(), *_clutter(building, wishes, rng, crowd))


def _groups(world: World) -> list[list[int]]:
    """Returns the pieces that can be moved, those together that go into each other; in the world's order."""
    outlines = [_outlines(piece) for piece in world.furniture]
    owner = list(range(len(outlines)))

    def root(number: int) -> int:
        while owner[number] != number:
            number = owner[number]
        return number

    boxes = np.array([_bounds(some) for some in outlines]).reshape(-1, 4)
    near = (boxes[:, None, :2] < boxes[None, :, 2:]) & (boxes[None, :, :2] < boxes[:, None, 2:])
    for one, other in np.argwhere(np.triu(near.all(axis=2), 1)).tolist():
        if any(_depth_m(a, b) > _JOINED_M for a in outlines[one] for b in outlines[other]):
            owner[root(other)] = root(one)
    groups: dict[int, list[int]] = {}
    for number, some in enumerate(outlines):
        if some:
            groups.setdefault(root(number), []).append(number)
    start = start_pose(world)
    return [
        group
        for group in groups.values()
        if _is_loose([each for number in group for each in outlines[number]], (start.x_m, start.y_m))
    ]


def _is_loose(outlines: Outlines, start_m: tuple[float, float]) -> bool:
    """Returns whether somebody may move it: it stands on the floor, is no wall, and is not around the start."""
    x_min, y_min, x_max, y_max = _bounds(outlines)
    holds_start = x_min <= start_m[0] <= x_max and y_min <= start_m[1] <= y_max
    stands = min(each.low_m for each in outlines) <= _STANDS_M
    return stands and not holds_start and max(x_max - x_min, y_max - y_min) <= _MOST_LENGTH_M


def _moved(
    pieces: Sequence[Furniture], wishes: VariantWishes, rng: np.random.Generator, others: _Crowd, world: World
) -> Sequence[Furniture]:
    """Returns pieces moved together to where they go into nothing; as they were where no such place was found."""
    x_min, y_min, x_max, y_max = _bounds([each for piece in pieces for each in _outlines(piece)])
    middle = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    most_turn_rad = min(_MOST_TURN_RAD, wishes.move_m / max(math.hypot(x_max - x_min, y_max - y_min) / 2, 0.01))
    for _ in range(_PIECE_TRIES):
        away_m, bearing = wishes.move_m * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
        by = (away_m * math.cos(bearing), away_m * math.sin(bearing), rng.uniform(-most_turn_rad, most_turn_rad))
        moved = [_placed(piece, middle, by) for piece in pieces]
        if _fits([each for piece in moved for each in _outlines(piece)], others, wishes, world):
            return moved
    return pieces


def _placed(piece: Furniture, about: tuple[float, float], by: tuple[float, float, float]) -> Furniture:
    """Returns a piece turned about a place, and shifted (x m, y m, yaw rad)."""
    cos, sin = math.cos(by[2]), math.sin(by[2])

    def there(x: float, y: float) -> tuple[float, float]:
        dx, dy = x - about[0], y - about[1]
        return rounded(about[0] + cos * dx - sin * dy + by[0]), rounded(about[1] + sin * dx + cos * dy + by[1])

    turned = [
        solid.model_copy(
            update={
                "center_m": (*there(*solid.center_m[:2]), solid.center_m[2]),
                "yaw_rad": 0.0 if solid.shape == "cylinder" else _turned(solid.yaw_rad, by[2]),
            }
        )
        for solid in piece.solids
    ]
    update = {"center_m": there(*piece.center_m), "yaw_rad": _turned(piece.yaw_rad, by[2]), "solids": tuple(turned)}
    return piece.model_copy(update=update)


def _turned(yaw_rad: float, by_rad: float) -> float:
    return rounded((yaw_rad + by_rad + math.pi) % math.tau - math.pi)


def _fits(outlines: Outlines, others: _Crowd, wishes: VariantWishes, world: World) -> bool:
    """Returns whether things stand within the world, away from its start, and go into nothing else."""
    outer, start, keep_m = world.footprint, start_pose(world), wishes.radius_m + _FREE_START_M
    x_min, y_min, x_max, y_max = _bounds(outlines)
    within = outer.x_min_m < x_min and outer.y_min_m < y_min and x_max < outer.x_max_m and y_max < outer.y_max_m
    away_m = math.hypot(max(x_min - start.x_m, start.x_m - x_max, 0.0), max(y_min - start.y_m, start.y_m - y_max, 0.0))
    if not within or away_m < keep_m:
        return False
    return not others.hits(outlines)


def _clutter(building: _Building, wishes: VariantWishes, rng: np.random.Generator, crowd: _Crowd) -> list[Furniture]:
    """Returns boxes and pallets on floor that the robot got to; fewer than asked for where there is no room."""
    world, grid = building.world, building.grid
    cells, names = np.argwhere(building.reached), {piece.name for piece in world.furniture}
    found: list[Furniture] = []
    for number in range(1, wishes.clutter + 1):
        name = next(each for each in (f"clutter_{number}", f"variant_clutter_{number}") if each not in names)
        for _ in range(_PIECE_TRIES):
            column, row = cells[rng.integers(len(cells))].tolist()
            piece = _clutter_piece(name, (float(grid.centers_m[0][column]), float(grid.centers_m[1][row])), rng)
            if _fits(_outlines(piece), crowd, wishes, world):
                found.append(piece)
                crowd.add(_outlines(piece))
                break
    return found


def _clutter_piece(name: str, at: tuple[float, float], rng: np.random.Generator) -> Furniture:
    """Returns a box of 0.25 to 0.7 m, or a Euro pallet that may carry one."""
    yaw_rad, pallet = rounded(rng.uniform(-math.pi, math.pi)), rng.random() < 0.4
    half = [rounded(rng.uniform(0.125, 0.35)) for _ in range(3)]
    made: list[tuple[str, tuple[float, float, float], float, Color]] = []
    if pallet:
        made.append(("pallet", _PALLET_HALF_M, 0.0, _WOOD))
    if not pallet or rng.random() < 0.5:
        made.append(("box", (half[0], half[1], half[2]), 2 * _PALLET_HALF_M[2] if pallet else 0.0, _CARDBOARD))
    x, y = rounded(at[0]), rounded(at[1])
    parts = [
        Solid(
            name=f"{name}_{part}",
            shape="box",
            center_m=(x, y, rounded(low_m + half_m[2])),
            half_extents_m=half_m,
            yaw_rad=yaw_rad,
            color=color,
        )
        for part, half_m, low_m, color in made
    ]
    kind = "pallet" if pallet else "box"
    return Furniture(name=name, model_type=kind, room="", center_m=(x, y), yaw_rad=yaw_rad, solids=tuple(parts))


def _outlines(piece: Furniture) -> list[_Outline]:
    return [_outline(solid) for solid in piece.solids if solid.center_m[2] - solid.half_extents_m[2] < HEADROOM_M]


def _outline(solid: Solid) -> _Outline:
    corners = np.array(corners_m(solid))
    if solid.shape == "cylinder":
        angles = np.arange(16) * (math.tau / 16)
        around = solid.half_extents_m[0] / math.cos(math.tau / 32)
        corners = around * np.stack([np.cos(angles), np.sin(angles)], axis=1) + solid.center_m[:2]
    z, half_z = solid.center_m[2], solid.half_extents_m[2]
    return _Outline(corners, z - half_z, z + half_z)


def _bounds(outlines: Outlines) -> tuple[float, float, float, float]:
    """Returns x_min, y_min, x_max, y_max; of nothing, nowhere."""
    if not outlines:
        return (math.inf, math.inf, -math.inf, -math.inf)
    corners = np.concatenate([each.corners for each in outlines])
    (x_min, y_min), (x_max, y_max) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return x_min, y_min, x_max, y_max


def _depth_m(one: _Outline, other: _Outline) -> float:
    """Returns how far two upright convex solids go into each other; below 0 where they do not.

    The least shift that parts them is along a side's normal (separating axis theorem), or upwards.
    """
    depth_m = min(one.high_m - other.low_m, other.high_m - one.low_m)
    low, high = one.corners.min(axis=0), one.corners.max(axis=0)
    depth_m = min(
        depth_m, float((high - other.corners.min(axis=0)).min()), float((other.corners.max(axis=0) - low).min())
    )
    if depth_m <= 0.0:
        return depth_m
    for outline in (one, other):
        sides = np.roll(outline.corners, -1, axis=0) - outline.corners
        normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.hypot(sides[:, 0], sides[:, 1])[:, None]
        on_one, on_other = one.corners @ normals.T, other.corners @ normals.T
        into = np.minimum(on_one.max(axis=0) - on_other.min(axis=0), on_other.max(axis=0) - on_one.min(axis=0))
        depth_m = min(depth_m, float(into.min()))
    return depth_m
