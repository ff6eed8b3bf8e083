"""Layouts in bulk, and how well they fulfil a template; a lower score is better.

A layout says where rooms stand, as lines that several of them share. Axes: ``layouts`` last, so that arithmetic runs
along memory; ``lines`` are the outline's four, then the inner walls' centre lines (``tasks.worlds.floorplan.slicing``
names them). The lower left corner of the outline is the origin.

A guarantee (a place for the start, all rooms reachable for the robot) weighs more than any wish, a wished connection
more than all shapes together. Everything is made of the four rules of arithmetic and the square root, which are the
same to the last bit on every machine.
"""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.world import RoomType
from tasks.worlds.geometry import EPSILON_M
from tasks.worlds.resolved_template import ResolvedTemplate, RoomWish

WALL_M = 0.12
OPENING_MIN_M = 1.4
JAMB_M = 0.1
"""Wall left standing at either side of a gap."""
START_SIDE_M = 2.1
"""Least width of the room that holds the start: the clear disc of 1 m radius and a hand's breadth."""
_DOORWAY_MIN_M = 0.9
# Beside the robot in a doorway: 0.1 m at either side, and what a grid of 5 cm cells can hide at any alignment, so that
# the certificate finds the robot to pass.
_ROBOT_PLAY_M = 0.23
_LEAF_M = 0.05  # what an open leaf takes of its doorway's width
HARD = 1e6
"""What a broken guarantee costs."""
CONNECTION = 1e3
"""What a wished connection costs that is not there; all other costs together are less."""
ASPECT_TOLERANCE = 0.225
"""``skew`` of 5:4, from where on a shape counts as missed; to miss it by so much costs its weight."""
AREA, AREA_TOLERANCE = 0.25, 0.02
"""What it costs to miss an area by so large a share."""
AREA_LIMIT, AREA_OVER = 0.022, 0.0015
"""Areas are missed by more than the limit only where nothing else helps: by so much more costs 1."""
SLIVER_M = 0.02
"""To be narrower than useful by so much costs 1."""
FOOTPRINT_LIMIT, FOOTPRINT_OVER = 0.9, 0.07
"""The same for a footprint that is spelt out, in tolerances."""
# How much aspects count. A wish of 1:1 is also what a template says that says nothing, and the outline of few rooms is
# what the rooms leave of it, so 1:1 weighs less than what is spelt out. With these weights 57 % of wished rooms of 1:1,
# 86 % of others, 29 % of footprints of 1:1 and 98 % of others are within 25 % over 23 templates, mean deviation 0.36;
# with 0.1, 3 and 0.01 (weights only) 45, 94, 24, 100 % and 0.45, and with 1, 1 and 0.2 for rooms of all kinds
# alike, 56, 65, 18 and 75 % and 0.36.
_DEFAULT_ROOM, _FOOTPRINT, _DEFAULT_FOOTPRINT_ROOM = 0.5, 1.0, 0.035
# Least widths of useful rooms; habitable ones as in the International Residential Code R304.2 (7 feet).
_HABITABLE_M, _HALLWAY_M, _OTHER_M = 2.13, 1.2, 1.6
_SLIM_SHARE = 0.65  # of a square room's side: a room of 10 m2 need not be as wide as all that
# What else costs: an aspect beyond the tolerance (times its weight), ways through a bathroom and through a bedroom, a
# dark room, and the share of wall that a connection lacks.
_MISSED, _THROUGH, _DARK, _SHORT = 2.0, (20.0, 6.0), 2.0, 10.0
LIT: frozenset[RoomType] = frozenset({"Bedroom", "Living", "Dining", "Kitchen"})
"""Types that want a window (habitable rooms, International Residential Code R202)."""
PRIVATE: frozenset[RoomType] = frozenset({"Bathroom", "Closet"})
"""Types that nobody wants to walk through."""


@dataclass(frozen=True)
class Layouts:
    """Layouts of the same rooms.

    Attributes:
        sides: The lines at the lowest x, lowest y, highest x and highest y of each room.
        vertical: Whether a line runs along y.
        lines: Where a line lies: its x if it runs along y, else its y (metres).
    """

    sides: Int[np.ndarray, "rooms 4 layouts"]
    vertical: Bool[np.ndarray, "lines layouts"]
    lines: Float[np.ndarray, "lines layouts"]

    def __getitem__(self, chosen: Int[np.ndarray, " some"]) -> "Layouts":
        """Returns some of the layouts."""
        return Layouts(self.sides[..., chosen], self.vertical[:, chosen], self.lines[:, chosen])

    def moved(self, lines: Float[np.ndarray, "lines layouts"]) -> "Layouts":
        """Returns the same layouts with their lines elsewhere."""
        return replace(self, lines=lines)

    def cells(self) -> Float[np.ndarray, "4 rooms layouts"]:
        """Returns the rooms' cells: lowest x and y, highest x and y, between wall centre lines."""
        return np.take_along_axis(self.lines[None], self.sides.transpose(1, 0, 2), axis=1)


def join_layouts(many: list[Layouts]) -> Layouts:
    """Returns several bulks of layouts as one."""
    return Layouts(
        np.concatenate([each.sides for each in many], axis=-1),
        np.concatenate([each.vertical for each in many], axis=-1),
        np.concatenate([each.lines for each in many], axis=-1),
    )


def common_walls(
    cells: Float[np.ndarray, "4 rooms layouts"], first: Int[np.ndarray, " pairs"], second: Int[np.ndarray, " pairs"]
) -> Float[np.ndarray, "pairs layouts"]:
    """Returns how far two cells lie side by side, for pairs of rooms (metres); 0 for cells that do not touch."""
    a, b = cells[:, first], cells[:, second]
    along = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    touching = np.abs(along) < EPSILON_M
    return np.maximum(np.where(touching[0], along[1], np.where(touching[1], along[0], 0.0)), 0.0)


@dataclass(frozen=True)
class Demands:
    """A template as arrays over rooms, and over the pairs of rooms that shall be connected.

    Attributes:
        aspect: Wished width over height by room.
        weight: How much a room's aspect counts.
        slim_m: Width below which a room is a sliver.
        lit: Which rooms want a window.
        quiet: Which rooms nobody should have to walk through: bathrooms and closets, and these with bedrooms.
        pairs: The rooms of each connected pair.
        shared_m: How far the cells of each pair must lie side by side.
        joint_m: The same for a doorway between any two rooms.
        narrow_m: Width below which the robot does not get about a room.
        footprint_over: What it costs 1 to miss the limit by, in tolerances; infinite for no limit.
    """

    areas_m2: Float[np.ndarray, " rooms"]
    aspect: Float[np.ndarray, " rooms"]
    weight: Float[np.ndarray, " rooms"]
    slim_m: Float[np.ndarray, " rooms"]
    lit: Bool[np.ndarray, " rooms"]
    quiet: Bool[np.ndarray, "2 rooms"]
    pairs: Int[np.ndarray, "2 pairs"]
    shared_m: Float[np.ndarray, " pairs"]
    joint_m: float
    narrow_m: float
    footprint_aspect: float
    footprint_weight: float
    footprint_over: float


def doorway_width(resolved: ResolvedTemplate) -> float:
    """Returns how wide doorways are: for a person, and for the robot with some play beside an open leaf (metres)."""
    leaf = 0.0 if resolved.doors is None else _LEAF_M
    needed = max(_DOORWAY_MIN_M, passable_width(resolved) + leaf)
    return math.ceil(round(100.0 * needed, 6)) / 100.0


def passable_width(resolved: ResolvedTemplate) -> float:
    """Returns how wide a room must be for the robot to get about it (metres)."""
    return 2.0 * resolved.robot_radius_m + _ROBOT_PLAY_M


def demands_of(resolved: ResolvedTemplate) -> Demands:
    """Returns a template as arrays."""
    aspect = np.array([room.aspect for room in resolved.rooms])
    doorway = doorway_width(resolved)
    shared: dict[tuple[int, int], float] = {}
    for wish, count in Counter(resolved.connections).items():
        width = max(OPENING_MIN_M, doorway) if wish.kind == "Opening" else doorway
        shared[wish.rooms] = shared.get(wish.rooms, WALL_M + JAMB_M) + count * (width + JAMB_M)
    return Demands(
        areas_m2=np.array([room.area_m2 for room in resolved.rooms]),
        aspect=aspect,
        weight=np.where(aspect == 1.0, _DEFAULT_ROOM, 1.0),
        slim_m=np.array([_sliver_width(room) for room in resolved.rooms]),
        lit=np.array([room.type in LIT for room in resolved.rooms]),
        quiet=np.array([[room.type in types for room in resolved.rooms] for types in (PRIVATE, PRIVATE | {"Bedroom"})]),
        pairs=np.array(list(shared), dtype=int).reshape(-1, 2).T,
        shared_m=np.array(list(shared.values())),
        joint_m=WALL_M + 2 * JAMB_M + doorway,
        narrow_m=passable_width(resolved),
        footprint_aspect=resolved.footprint_aspect,
        footprint_weight=_DEFAULT_FOOTPRINT_ROOM * len(aspect) if resolved.footprint_aspect == 1.0 else _FOOTPRINT,
        footprint_over=math.inf if resolved.footprint_aspect == 1.0 else FOOTPRINT_OVER,
    )


def _sliver_width(room: RoomWish) -> float:
    least = _HABITABLE_M if room.type in LIT - {"Kitchen"} else _HALLWAY_M if room.type == "Hallway" else _OTHER_M
    wished = math.sqrt(room.area_m2 * min(room.aspect, 1.0 / room.aspect))
    return min(least, _SLIM_SHARE * math.sqrt(room.area_m2), wished)


def skew(ratio: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Returns how far an aspect ratio is from the wished one: 0, and negative when it is as much too deep."""
    return (ratio - 1.0 / ratio) / 2.0


def score(layouts: Layouts, demands: Demands) -> Float[np.ndarray, " layouts"]:
    """Returns what layouts cost that are drawn to the centimetre."""
    cells = layouts.cells()
    return (
        _shape_cost(layouts, cells, demands)
        + _connection_cost(cells, demands)
        + _reach_cost(cells, demands)
        + sum(
            cost * _count_walk_throughs(cells, demands, quiet)
            for cost, quiet in zip(_THROUGH, demands.quiet, strict=True)
        )
        + _DARK * _count_dark(layouts, demands)
    )


def _miss_cost(ratio: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    relative = skew(ratio) / ASPECT_TOLERANCE
    return relative * relative + _MISSED * (np.abs(relative) > 1.0)


def _shape_cost(
    layouts: Layouts, cells: Float[np.ndarray, "4 rooms layouts"], demands: Demands
) -> Float[np.ndarray, " layouts"]:
    """Returns what areas, aspects and widths cost, and no room that the start fits into."""
    extent = np.maximum(cells[2:] - cells[:2] - WALL_M, 1e-3)
    side = extent.min(axis=0)
    error = np.abs(extent[0] * extent[1] / demands.areas_m2[:, None] - 1.0)
    over = np.maximum(error - AREA_LIMIT, 0.0) / AREA_OVER
    sliver = np.maximum(demands.slim_m[:, None] - side, 0.0) / SLIVER_M
    rooms = (
        demands.weight[:, None] * _miss_cost(extent[0] / extent[1] / demands.aspect[:, None])
        + AREA * (error / AREA_TOLERANCE) ** 2
        + over * over
        + sliver * sliver
    )
    outline = (layouts.lines[2] + WALL_M) / (layouts.lines[3] + WALL_M) / demands.footprint_aspect
    beyond = np.maximum(np.abs(skew(outline)) / ASPECT_TOLERANCE - FOOTPRINT_LIMIT, 0.0) / demands.footprint_over
    footprint = demands.footprint_weight * _miss_cost(outline) + beyond * beyond
    impassable = (side.max(axis=0) < START_SIDE_M) | (side.min(axis=0) < demands.narrow_m)
    return rooms.sum(axis=0) + footprint + HARD * impassable


def _connection_cost(cells: Float[np.ndarray, "4 rooms layouts"], demands: Demands) -> Float[np.ndarray, " layouts"]:
    """Returns what it costs that wished pairs lie side by side for too short a way."""
    needed = demands.shared_m[:, None]
    missing = np.maximum(needed - 1e-6 - common_walls(cells, *demands.pairs), 0.0) / needed
    return (CONNECTION * (missing > 0.0) + _SHORT * missing).sum(axis=0)


def _joints(cells: Float[np.ndarray, "4 rooms layouts"], demands: Demands) -> Bool[np.ndarray, "rooms rooms layouts"]:
    rooms = cells.shape[1]
    first, second = np.triu_indices(rooms, 1)
    joints = np.zeros((rooms, rooms, cells.shape[2]), dtype=bool)
    joints[first, second] = common_walls(cells, first, second) >= demands.joint_m - 1e-6
    return joints | joints.transpose(1, 0, 2)


def _reach_cost(cells: Float[np.ndarray, "4 rooms layouts"], demands: Demands) -> Float[np.ndarray, " layouts"]:
    """Returns what it costs that doorways cannot join all rooms."""
    return HARD * ~all_connected(_joints(cells, demands))


def _count_walk_throughs(
    cells: Float[np.ndarray, "4 rooms layouts"], demands: Demands, quiet: Bool[np.ndarray, " rooms"]
) -> Float[np.ndarray, " layouts"]:
    """Returns how often the only way leads through a quiet room, where the template does not say so."""
    if quiet.all() or not quiet.any():
        return np.zeros(cells.shape[2])
    joints = _joints(cells, demands)
    wished = np.isin(np.arange(len(quiet)), demands.pairs)
    apart = ~all_connected(joints[np.ix_(~quiet, ~quiet)])
    alone = ~joints[np.ix_(quiet & ~wished, ~quiet)].any(axis=1)
    return apart + alone.sum(axis=0)


def _count_dark(layouts: Layouts, demands: Demands) -> Float[np.ndarray, " layouts"]:
    """Returns how many rooms that want a window have no outer wall."""
    return (layouts.sides[demands.lit] > 3).all(axis=1).sum(axis=0).astype(float)


def all_connected(adjacent: Bool[np.ndarray, "rooms rooms graphs"]) -> Bool[np.ndarray, " graphs"]:
    """Returns for each graph whether all rooms hang together."""
    reached = adjacent[0].copy()
    reached[0] = True
    for _ in range(len(adjacent) - 1):
        reached |= (reached[:, None] & adjacent).any(axis=0)
    return reached.all(axis=0)
