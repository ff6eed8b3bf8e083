"""Refinement: moves the walls of many layouts at once until areas, shapes and connections are the best compromise.

Damped Gauss-Newton on what ``tasks.worlds.floorplan.scoring`` counts smoothly. Written out in elementary operations
rather than with a linear algebra library, whose last bits differ from machine to machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from tasks.worlds.floorplan.room_layouts import Layouts
from tasks.worlds.floorplan.scoring import (
    AREA,
    AREA_LIMIT,
    AREA_OVER,
    AREA_TOLERANCE,
    ASPECT_TOLERANCE,
    FOOTPRINT_LIMIT,
    SLIVER_M,
    START_SIDE_M,
    WALL_M,
    Demands,
    score,
    skew,
)

_ROUNDS = 6
_DAMPING = 1e-3
# Aspects this near to the tolerance count this much more in the second half: over 23 templates 57 % of wishes for 1:1
# and 86 % of the others are met with it, 54 and 76 % without.
_NEAR, _EFFORT = (0.5, 1.5), 4.0
# A room keeps this share of its width in one round.
_KEPT = 0.5
# Limits are kept with this to spare, for rounding to the centimetre; to miss one by so much costs 1.
_SPARE_M, _LIMIT_M, _HARD_M = 0.015, 0.01, 0.001

Residuals = Float[np.ndarray, "rows layouts"]
Slopes = Float[np.ndarray, "rows lines layouts"]


@dataclass(frozen=True)
class _Frame:
    """What does not change from round to round.

    Attributes:
        spread: How each room's width and height depend on the lines.
        least_m: What each room must measure, for the robot and in one of them for the start.
        facing: For each pair, the axis along which its common wall runs, -1 for none.
        weight: How much each aspect counts.
    """

    spread: Float[np.ndarray, "2 rooms lines layouts"]
    least_m: Float[np.ndarray, "rooms layouts"]
    facing: Int[np.ndarray, "pairs layouts"]
    weight: Float[np.ndarray, "rooms layouts"]


def refine(layouts: Layouts, demands: Demands) -> Layouts:
    """Returns the layouts with their lines where the score is best, in whole centimetres."""
    frame, found = _make_frame(layouts, demands), [np.round(layouts.lines, 2)]
    for _ in range(2):
        for _ in range(_ROUNDS):
            layouts = layouts.moved(_improve_lines(layouts, demands, frame))
        found.append(np.round(layouts.lines, 2))
        frame = replace(frame, weight=_sharpen_weights(layouts, demands))
    best = np.argmin([np.round(score(layouts.moved(lines), demands), 4) for lines in found], axis=0)
    return layouts.moved(np.take_along_axis(np.stack(found), best[None, None], axis=0)[0])


def _make_frame(layouts: Layouts, demands: Demands) -> _Frame:
    ids = np.arange(len(layouts.lines))[:, None]
    at = layouts.sides.transpose(1, 0, 2)[:, :, None] == ids
    cells = layouts.cells()
    rooms, start = np.arange(len(at[0]))[:, None], np.argmax((cells[2:] - cells[:2]).min(axis=0), axis=0)
    a, b = layouts.sides[demands.pairs[0]], layouts.sides[demands.pairs[1]]
    beside = (a[:, :2] == b[:, 2:]) | (b[:, :2] == a[:, 2:])
    return _Frame(
        spread=at[2:].astype(float) - at[:2],
        least_m=np.where(rooms == start, max(START_SIDE_M, demands.narrow_m), demands.narrow_m),
        facing=np.where(beside[:, 0], 1, np.where(beside[:, 1], 0, -1)),
        weight=np.broadcast_to(demands.weight[:, None], (len(rooms), len(start))),
    )


def _sharpen_weights(layouts: Layouts, demands: Demands) -> Float[np.ndarray, "rooms layouts"]:
    """Returns the weights of aspects, higher for those that a little effort can get or keep within the tolerance."""
    cells = layouts.cells()
    width, height = cells[2:] - cells[:2] - WALL_M
    missed = np.abs(skew(width / height / demands.aspect[:, None])) / ASPECT_TOLERANCE
    near = (missed > _NEAR[0]) & (missed < _NEAR[1])
    return demands.weight[:, None] * np.where(near, _EFFORT, 1.0)


def _improve_lines(layouts: Layouts, demands: Demands, frame: _Frame) -> Float[np.ndarray, "lines layouts"]:
    """Returns where the lines lie after one round."""
    terms = list(_terms(layouts, demands, frame))
    rows = np.concatenate([term[0] for term in terms])
    slopes = np.concatenate([term[1] for term in terms])
    free = slopes[:, 2:]  # the outline's lower left corner stays
    normal = np.stack([(free * free[:, n, None]).sum(axis=0) for n in range(free.shape[1])])
    step = np.zeros_like(layouts.lines)
    step[2:] = _solve(normal, -(free * rows[:, None]).sum(axis=0))
    extent = (frame.spread * layouts.lines).sum(axis=2)
    shrinking = np.maximum(-(frame.spread * step).sum(axis=2) / extent, 1e-9)
    return layouts.lines + np.minimum(_KEPT / shrinking.max(axis=(0, 1)), 1.0) * step


def _terms(layouts: Layouts, demands: Demands, frame: _Frame) -> Iterator[tuple[Residuals, Slopes]]:
    """Yields what is missed, as the score counts it, with its slopes: areas, aspects, outline, widths, connections."""
    spread = frame.spread
    extent = np.maximum((spread * layouts.lines).sum(axis=2) - WALL_M, 1e-2)
    relative = spread / extent[:, :, None]
    area = extent[0] * extent[1] / demands.areas_m2[:, None]
    scale = AREA**0.5 / AREA_TOLERANCE
    yield scale * (area - 1.0), scale * area[:, None] * (relative[0] + relative[1])
    ratio = extent[0] / extent[1] / demands.aspect[:, None]
    yield _skew_terms(ratio, relative[0] - relative[1], frame.weight)
    yield from _outline_terms(layouts, demands)
    for sign in (1.0, -1.0):
        yield _limit_terms(
            sign * (area - 1.0) - AREA_LIMIT, sign * area[:, None] * (relative[0] + relative[1]), AREA_OVER
        )
    for axis in (0, 1):
        yield _limit_terms(demands.slim_m[:, None] + _SPARE_M - extent[axis], -spread[axis], SLIVER_M)
        yield _limit_terms(frame.least_m + _SPARE_M - extent[axis], -spread[axis], _HARD_M)
    yield _connection_terms(layouts, demands, frame)


def _skew_terms(ratio: Residuals, relative: Slopes, weight: Residuals) -> tuple[Residuals, Slopes]:
    """Returns by how much aspects miss the wished ones."""
    scale = np.sqrt(weight) / ASPECT_TOLERANCE
    return scale * skew(ratio), (scale * (ratio + 1.0 / ratio) / 2.0)[:, None] * relative


def _outline_terms(layouts: Layouts, demands: Demands) -> Iterator[tuple[Residuals, Slopes]]:
    """Yields by how much the footprint misses its aspect, and the limit of what counts as met."""
    lines = layouts.lines[None]
    width, height = lines[:, 2] + WALL_M, lines[:, 3] + WALL_M
    relative = np.zeros_like(lines)
    relative[:, 2], relative[:, 3] = 1.0 / width, -1.0 / height
    ratio, weight = width / height / demands.footprint_aspect, np.full((1, 1), demands.footprint_weight)
    yield _skew_terms(ratio, relative, weight)
    missed, slopes = _skew_terms(ratio, relative, np.ones((1, 1)))
    sign = np.where(missed < 0.0, -1.0, 1.0)
    yield _limit_terms(sign * missed - FOOTPRINT_LIMIT, sign[:, None] * slopes, demands.footprint_over)


def _limit_terms(short: Residuals, slopes: Slopes, scale: float) -> tuple[Residuals, Slopes]:
    """Returns by how much limits are missed; those that are kept count nothing."""
    return np.maximum(short, 0.0) / scale, np.where(short > 0.0, 1.0, 0.0)[:, None] * slopes / scale


def _connection_terms(layouts: Layouts, demands: Demands, frame: _Frame) -> tuple[Residuals, Slopes]:
    """Returns by how much the walls between connected rooms are too short."""
    a, b = demands.pairs
    along = np.maximum(frame.facing, 0)[:, None]
    sides = [np.take_along_axis(layouts.sides[room], along + side, axis=1)[:, 0] for side in (0, 2) for room in (a, b)]
    here = [np.take_along_axis(layouts.lines, side, axis=0) for side in sides]
    low = np.where(here[0] > here[1], sides[0], sides[1])
    high = np.where(here[2] < here[3], sides[2], sides[3])
    length = np.minimum(here[2], here[3]) - np.maximum(here[0], here[1])
    short = np.where(frame.facing >= 0, demands.shared_m[:, None] + _SPARE_M - length, 0.0)
    ids = np.arange(len(layouts.lines))[:, None]
    slopes = (low[:, None] == ids).astype(float) - (high[:, None] == ids)
    return _limit_terms(short, slopes, _LIMIT_M)


def _solve(
    normal: Float[np.ndarray, "size size layouts"], right: Float[np.ndarray, "size layouts"]
) -> Float[np.ndarray, "size layouts"]:
    """Returns the solutions of symmetric positive systems, by elimination of all at once."""
    size = len(right)
    left = normal.copy()
    for n in range(size):
        left[n, n] += _DAMPING * (1.0 + left[n, n])
    right = right.copy()
    for n in range(size - 1):
        factor = left[n + 1 :, n] / left[n, n]
        left[n + 1 :, n:] -= factor[:, None] * left[n, n:]
        right[n + 1 :] -= factor * right[n]
    for n in reversed(range(size)):
        right[n] -= (left[n, n + 1 :] * right[n + 1 :]).sum(axis=0)
        right[n] /= left[n, n]
    return right
