"""Where a piece of furniture may stand in a room: candidates in bulk, and what keeps them out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.catalogue import Companion, Model, ModelType
from tasks.worlds.floorplan import START_CLEAR_M
from tasks.worlds.geometry import EPSILON_M, Box, meeting
from tasks.worlds.parts import Size

_CANDIDATES = 40
_WALL_GAP_M = 0.02
_ROW_GAP_M = 0.005
_ASKEW_RAD = 0.3
_CENTER_INSET_M = 0.5


@dataclass(frozen=True)
class Piece:
    """A piece that stands in a room.

    Attributes:
        quarter: Which way it faces, in quarter turns from +y, counter-clockwise.
        askew_rad: How far it is turned beyond that.
        body: The axis-aligned box around it.
        front: Floor that is kept free for using it.
        row: Whether others of a row may stand flush beside it.
    """

    type: ModelType
    size: Size
    center: tuple[float, float]
    quarter: int
    askew_rad: float
    body: Box
    front: Box
    row: bool = False


@dataclass
class Scene:
    """A room while it is being furnished.

    Attributes:
        floor: The room's floor.
        keep_clear: Floor before passages, where nothing stands.
        pieces: What stands already.
    """

    floor: Box
    keep_clear: tuple[Box, ...]
    pieces: list[Piece] = field(default_factory=list[Piece])


@dataclass(frozen=True)
class _Candidates:
    """Places to try: centres, facings, and the boxes that would be covered and kept free."""

    centers: Float[np.ndarray, "many 2"]
    quarters: Int[np.ndarray, " many"]
    bodies: Float[np.ndarray, "many 4"]
    fronts: Float[np.ndarray, "many 4"]


def place(rng: np.random.Generator, scene: Scene, kind: ModelType, model: Model, size: Size) -> Piece | None:
    """Returns where a piece goes in the scene, or None when no place tried is free."""
    askew = round(_ASKEW_RAD * (2 * float(rng.random()) - 1), 3) if model.turns else 0.0
    cos, sin = abs(math.cos(askew)), abs(math.sin(askew))
    extent = (size[0] * cos + size[1] * sin, size[0] * sin + size[1] * cos)
    centers, quarters = _spots(rng, scene, model, extent)
    candidates = _candidates(centers, quarters, extent, model)
    free = np.flatnonzero(_free(scene, candidates))
    if free.size == 0:
        return None
    chosen = free[int(np.argmin(_dislike(kind, scene, candidates)[free]))]
    return Piece(
        kind,
        size,
        (round(float(centers[chosen, 0]), 3), round(float(centers[chosen, 1]), 3)),
        int(quarters[chosen]),
        askew,
        Box(*candidates.bodies[chosen].tolist()),
        Box(*candidates.fronts[chosen].tolist()),
        model.row,
    )


def place_companion(scene: Scene, owner: Piece, companion: Companion, size: Size) -> Piece | None:
    """Returns where a companion goes beside its owner, or None when that place is taken."""
    offset = _beside(owner.size, companion, size)
    quarter = (owner.quarter + companion.turned) % 4
    dx, dy = turned(offset, owner.quarter)
    center = (round(owner.center[0] + dx, 3), round(owner.center[1] + dy, 3))
    half_x, half_y = (size[0] / 2, size[1] / 2) if quarter % 2 == 0 else (size[1] / 2, size[0] / 2)
    body = Box(center[0] - half_x, center[1] - half_y, center[0] + half_x, center[1] + half_y)
    boxes = np.array([body])
    others = Scene(scene.floor, scene.keep_clear, [piece for piece in scene.pieces if piece is not owner])
    candidate = _Candidates(np.array([center]), np.array([quarter]), boxes, boxes)
    if not _free(others, candidate)[0] or owner.body.meets(body):
        return None
    return Piece(companion.type, size, center, quarter, 0.0, body, body)


def turned(point: tuple[float, float], quarter: int) -> tuple[float, float]:
    """Returns a point turned counter-clockwise about the origin by quarter turns, exactly."""
    x, y = point
    return ((x, y), (-y, x), (-x, -y), (y, -x))[quarter % 4]


def _beside(owner: Size, companion: Companion, size: Size) -> tuple[float, float]:
    """Returns a companion's centre in its owner's frame."""
    width, depth = (size[0], size[1]) if companion.turned % 2 == 0 else (size[1], size[0])
    aside = owner[0] / 2 + companion.gap_m + width / 2
    ahead = owner[1] / 2 + companion.gap_m + depth / 2
    row = depth / 2 - owner[1] / 2
    return {
        "front": (0.0, ahead),
        "back": (0.0, -ahead),
        "left": (-aside, 0.0),
        "right": (aside, 0.0),
        "row-left": (-aside, row),
        "row-right": (aside, row),
    }[companion.side]


def _spots(
    rng: np.random.Generator, scene: Scene, model: Model, extent: tuple[float, float]
) -> tuple[Float[np.ndarray, "many 2"], Int[np.ndarray, " many"]]:
    """Returns centres and facings to try, for the way in which the model stands."""
    quarters = rng.integers(0, 4, _CANDIDATES)
    along, snap = rng.random((2, _CANDIDATES))
    half = np.where((quarters % 2 == 0)[:, None], [[extent[0] / 2, extent[1] / 2]], [[extent[1] / 2, extent[0] / 2]])
    floor = scene.floor
    if model.anchor == "center":
        low = np.array([floor.x_min, floor.y_min]) + half + _CENTER_INSET_M
        high = np.array([floor.x_max, floor.y_max]) - half - _CENTER_INSET_M
        return np.round(low + np.stack([along, snap], axis=1) * (high - low), 3), quarters
    low = np.array([floor.x_min, floor.y_min]) + half + _WALL_GAP_M
    high = np.array([floor.x_max, floor.y_max]) - half - _WALL_GAP_M
    corner = snap < (1.0 if model.anchor == "corner" else 0.35)
    along = np.where(corner, np.round(along), along)
    free = low + along[:, None] * (high - low)
    # The back stands at the south, east, north or west wall for 0, 1, 2 or 3 quarter turns.
    x = np.where(quarters == 1, high[:, 0], np.where(quarters == 3, low[:, 0], free[:, 0]))
    y = np.where(quarters == 0, low[:, 1], np.where(quarters == 2, high[:, 1], free[:, 1]))
    spots = np.round(np.stack([x, y], axis=1), 3)
    if not model.row:
        return spots, quarters
    beside, facing = _in_row([piece for piece in scene.pieces if piece.row], extent)
    return np.concatenate([beside, spots]), np.concatenate([facing, quarters])


def _in_row(
    pieces: Sequence[Piece], extent: tuple[float, float]
) -> tuple[Float[np.ndarray, "some 2"], Int[np.ndarray, " some"]]:
    """Returns the places flush beside every piece of a row, backs in line."""
    spots: list[tuple[float, float]] = []
    facings: list[int] = []
    for piece in pieces:
        aside = piece.size[0] / 2 + _ROW_GAP_M + extent[0] / 2
        back = (extent[1] - piece.size[1]) / 2
        for side in (-aside, aside):
            dx, dy = turned((side, back), piece.quarter)
            spots.append((round(piece.center[0] + dx, 3), round(piece.center[1] + dy, 3)))
            facings.append(piece.quarter)
    return np.array(spots).reshape(-1, 2), np.array(facings, dtype=int)


def _candidates(
    centers: Float[np.ndarray, "many 2"], quarters: Int[np.ndarray, " many"], extent: tuple[float, float], model: Model
) -> _Candidates:
    swapped = (quarters % 2 == 1)[:, None]
    half = np.where(swapped, [[extent[1] / 2, extent[0] / 2]], [[extent[0] / 2, extent[1] / 2]])
    bodies = np.concatenate([centers - half, centers + half], axis=1)
    reach = np.full((len(quarters), 4), model.front_m if model.anchor == "center" else 0.0)
    if model.anchor != "center":
        # South-backed pieces (0) face +y, then -x, -y, +x: columns are x_min, y_min, x_max, y_max.
        reach[np.arange(len(quarters)), np.array([3, 0, 1, 2])[quarters]] = model.front_m
    return _Candidates(centers, quarters, bodies, bodies + reach * np.array([-1.0, -1.0, 1.0, 1.0]))


def _free(scene: Scene, candidates: _Candidates) -> Bool[np.ndarray, " many"]:
    """Returns which candidates stand on the floor, and in nobody's way."""
    bodies, fronts, floor = candidates.bodies, candidates.fronts, scene.floor
    inside = (fronts[:, :2] >= np.array(floor[:2]) - EPSILON_M) & (fronts[:, 2:] <= np.array(floor[2:]) + EPSILON_M)
    gap = np.maximum(np.maximum(bodies[:, :2], -bodies[:, 2:]), 0.0)
    free = inside.all(axis=1) & (gap[:, 0] ** 2 + gap[:, 1] ** 2 >= START_CLEAR_M**2)
    taken = [*scene.keep_clear, *(piece.body for piece in scene.pieces), *(piece.front for piece in scene.pieces)]
    if taken:
        free &= ~meeting(bodies, np.array(taken))
    if scene.pieces:
        free &= ~meeting(fronts, np.array([piece.body for piece in scene.pieces]))
    return free


def _dislike(kind: ModelType, scene: Scene, candidates: _Candidates) -> Float[np.ndarray, " many"]:
    """Returns how little each place suits the type: a screen faces the sofa."""
    sofas = [piece for piece in scene.pieces if piece.type == "Sofas"]
    if kind != "MediaStorage" or not sofas:
        return np.zeros(len(candidates.quarters))
    across = 0 if sofas[0].quarter % 2 == 0 else 1
    aside = np.abs(candidates.centers[:, across] - sofas[0].center[across])
    return aside + 10.0 * (candidates.quarters != (sofas[0].quarter + 2) % 4)
