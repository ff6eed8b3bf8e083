"""A world is data: one canonical JSON document that everything downstream reads.

Metres, radians, z up. The origin is where the robot starts: the floor is at z = 0 and a disc of 1 m radius around
(0, 0) is free (docs/reference/robomaker.md, section 5).
"""

import math
import operator
from collections.abc import Sequence
from functools import reduce
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, model_validator

from specs.base import Spec
from specs.rules import broken

if TYPE_CHECKING:
    import numpy as np

WORLD_VERSION = "2"
"""Of what is written where a world holds prisms, a start or a source; all others are of version 1 to the byte."""

MOST_CORNERS = 8
"""Of a prism; an outline of more is cut, so that engines hold all prisms in arrays of one shape."""

ROBOT_RADIUS_M = 0.25
"""Radius of the robot that worlds are passable for unless somebody asks for another: common indoor bases have less."""

OVERHEAD_M = 2.2
"""What begins higher hangs above everybody: it is imported coarsely, and left out of pictures that it would cover."""

RoomType = Literal["Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet"]
Color = tuple[float, float, float]
"""sRGB, each 0-1."""
Pattern = Literal["plain", "fibres", "planks", "parquet", "tiles", "bricks", "stones", "panels", "stripes"]


_later: Any = Field(
    default=None, exclude_if=lambda value: value is None
)  # what documents of version 1 have no field for


class Rectangle(Spec):
    """An axis-aligned rectangle on the floor, by its corners (metres, maxima above minima)."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


class Solid(Spec):
    """One static primitive: what is drawn, collided with and seen by the lidar.

    Attributes:
        name: Unique in the world; becomes the geom's name.
        shape: A box, an upright cylinder whose radius is both of the first two half extents, or an upright prism.
        center_m: Centre (x, y, z).
        half_extents_m: Half sizes along the solid's own axes (x, y, z), all positive; a prism's are those of the box
            around it.
        yaw_rad: Turn about z, counter-clockwise; 0 for cylinders.
        color: sRGB, each 0-1.
        outline_m: A prism's 3 to 8 corners from its centre along its own axes, counter-clockwise, convex; else none.
    """

    name: str
    shape: Literal["box", "cylinder", "prism"]
    center_m: tuple[float, float, float]
    half_extents_m: tuple[float, float, float]
    yaw_rad: float
    color: Color
    outline_m: tuple[tuple[float, float], ...] | None = _later

    @model_validator(mode="after")
    def _check_outline(self) -> Self:
        corners = self.outline_m
        if (corners is None) is (self.shape == "prism"):
            raise broken("outline_m: corners for a prism, and none for another shape")
        if corners is not None and not (3 <= len(corners) <= MOST_CORNERS and is_convex(corners)):
            raise broken(f"outline_m: 3 to {MOST_CORNERS} corners (x, y) of a convex outline, counter-clockwise")
        half_x, half_y, _ = self.half_extents_m
        if corners and not (_reaches([x for x, _ in corners], half_x) and _reaches([y for _, y in corners], half_y)):
            raise broken("outline_m: corners that reach from -half_extents_m to half_extents_m")
        return self


def corners_m(solid: Solid) -> list[tuple[float, float]]:
    """Returns the corners of a solid's outline, counter-clockwise; of a cylinder, of the square around it."""
    x_m, y_m, _ = solid.center_m
    half_x_m, half_y_m, _ = solid.half_extents_m
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    box = ((-half_x_m, -half_y_m), (half_x_m, -half_y_m), (half_x_m, half_y_m), (-half_x_m, half_y_m))
    return [(x_m + u * cos - v * sin, y_m + u * sin + v * cos) for u, v in solid.outline_m or box]


def is_convex(corners: Sequence[tuple[float, float]]) -> bool:
    """Returns whether an outline turns left at every corner, and once around in all."""
    sides = [(bx - ax, by - ay) for (ax, ay), (bx, by) in pairwise([*corners, corners[0]])]
    turns = [math.atan2(ax * by - ay * bx, ax * bx + ay * by) for (ax, ay), (bx, by) in pairwise([*sides, sides[0]])]
    return min(turns) > 0.0 and abs(sum(turns) - math.tau) < 1e-6


def _reaches(values: Sequence[float], most: float) -> bool:
    """Returns whether coordinates, each rounded to a millionth, reach equally far to both sides."""
    return max(abs(max(values) - most), abs(min(values) + most)) < 2e-6


class Finish(Spec):
    """What a floor, or the walls of a room, are covered with; every exporter draws it from these figures.

    Attributes:
        material: RoboMaker's name, such as ``Floorboards`` or ``Wall paint``.
        pattern: How the surface is divided.
        color: Of most of the surface.
        accent: Of its joints, its grain or its print.
        repeat_m: Extent of one unit of the pattern: a plank, a tile, a course of bricks (along, then across or up).
    """

    material: str
    pattern: Pattern
    color: Color
    accent: Color
    repeat_m: tuple[float, float]


class Room(Spec):
    """One room: the inner floor area between its walls' faces, and what floor and walls are covered with."""

    name: str
    type: RoomType
    floor: Rectangle
    flooring: Finish
    walls: Finish

    def holds(self, x_m: "np.ndarray", y_m: "np.ndarray") -> "np.ndarray":
        """Returns which points lie in the room."""
        low, high = (self.floor.x_min_m, self.floor.y_min_m), (self.floor.x_max_m, self.floor.y_max_m)
        return (x_m >= low[0]) & (x_m <= high[0]) & (y_m >= low[1]) & (y_m <= high[1])


class Passage(Spec):
    """A way from one room to another through a gap in their wall.

    Attributes:
        rooms: The names of the two rooms.
        kind: A doorway (a door's width) or an opening (wide).
        center_m: Middle of the gap on the floor.
        width_m: Clear width.
        along: The axis that the wall runs along; one walks through across it.
        desired: Whether the template asked for it; False for one added so that every room is reachable.
    """

    rooms: tuple[str, str]
    kind: Literal["Doorway", "Opening"]
    center_m: tuple[float, float]
    width_m: float
    along: Literal["x", "y"]
    desired: bool


class Door(Spec):
    """A hinged door in a doorway (templates of version 2), at its initial opening.

    The leaf turns about a vertical axis through ``hinge_m``; seen from there it points along ``closed_yaw_rad`` when
    it is shut and along ``open_yaw_rad``, a quarter turn from it, when it is fully open.

    Attributes:
        name: Unique in the world.
        passage: Which passage it hangs in, an index into the world's passages.
        opens_into: The room that the leaf swings into.
        open_percent: 0 is shut, 100 a quarter turn open.
        leaf: The leaf as it stands.
    """

    name: str
    passage: int
    opens_into: str
    hinge_m: tuple[float, float]
    closed_yaw_rad: float
    open_yaw_rad: float
    open_percent: float
    leaf: Solid


class Window(Spec):
    """A window in an outer wall: seen, but neither collided with nor scanned (its sill is above a robot's lidar).

    Attributes:
        room: The room that it lights.
        center_m: Middle of the window on the wall's centre line.
        along: The axis that the wall runs along.
        bottom_m: Height of the sill.
        top_m: Height of the head.
    """

    room: str
    center_m: tuple[float, float]
    width_m: float
    along: Literal["x", "y"]
    bottom_m: float
    top_m: float


class OccupancyMap(Spec):
    """The floor as a grid, row by row from the lowest y, each row from the lowest x.

    A cell is occupied when a solid that is not above head height, or the world outside the walls, touches it. Doors
    are as they stand.

    Attributes:
        resolution_m: Side of a cell.
        origin_m: Lower left corner of the first cell.
        runs: Lengths of alternating runs of free and occupied cells, beginning with free ones (may be 0); they add
            up to columns x rows.
    """

    resolution_m: float
    origin_m: tuple[float, float]
    columns: int
    rows: int
    runs: tuple[int, ...]


class Furniture(Spec):
    """One piece of furniture, or of an imported scene: a name, what it is, where it stands, and its primitives.

    Attributes:
        room: The name of its room; empty in a world without rooms.
    """

    name: str
    model_type: str
    room: str
    center_m: tuple[float, float]
    yaw_rad: float
    solids: tuple[Solid, ...]


class Light(Spec):
    """A ceiling light."""

    position_m: tuple[float, float, float]


class Wish(Spec):
    """One wish of the template beside what became of it.

    Attributes:
        subject: The room, ``Kitchen - Hall`` for a pair, or ``footprint``.
        wished: For a person, such as ``20 m2``, ``2 doorways``, ``Tiles or Carpet``.
        found: For a person, in the same terms.
        error: By what share the found figure misses the wished one, where both are figures; 0 for none.
    """

    kind: Literal["area", "aspect", "footprint", "connection", "flooring", "walls", "furniture", "density", "door"]
    subject: str
    wished: str
    found: str
    met: bool
    error: float | None = None


class RoomFigures(Spec):
    """One room's share of the certificate.

    Attributes:
        free_floor_share: Floor not under or in furniture, 0-1.
        reached_share: Of the floor that is wide enough for the guaranteed robot, how much it gets to, 0-1.
    """

    room: str
    area_m2: float
    free_floor_share: float
    reached_share: float


class Certificate(Spec):
    """What is guaranteed about a world, measured on the finished geometry, and what became of the template's wishes.

    Attributes:
        origin_clear_radius_m: Distance from (0, 0) to the nearest solid below head height; at least 1.
        guaranteed_robot_radius_m: Robot radius that the world was asked to be passable for.
        reachable_robot_radius_m: Largest robot radius with which every room is reached from the origin, doors opened;
            at least the guaranteed one.
        doors_as_set_robot_radius_m: The same with the doors as they stand; 0 when a shut door keeps a room away.
        narrowest_passage_m: Clear width of the narrowest passage, 0 for a world of one room.
        free_floor_share: Floor not covered by furniture, over all floor, 0-1.
        area_error_mean: Mean over rooms of |area - desired| / desired.
        overlaps: Pairs of furniture pieces, doors or walls that intersect; 0.
        rooms: Figures by room, in the world's order.
        wishes: Every measurable wish of the template.
    """

    origin_clear_radius_m: float
    guaranteed_robot_radius_m: float
    reachable_robot_radius_m: float
    doors_as_set_robot_radius_m: float
    narrowest_passage_m: float
    free_floor_share: float
    area_error_mean: float
    overlaps: int
    rooms: tuple[RoomFigures, ...] = ()
    wishes: tuple[Wish, ...] = ()

    @property
    def unmet(self) -> tuple[str, ...]:
        """One sentence for each wish that the world does not fulfil."""
        return tuple(f"{wish.subject}: {wish.found}, wished {wish.wished}" for wish in self.wishes if not wish.met)


class Start(Spec):
    """Where a robot starts in a world that was imported, in the frame of its source."""

    x_m: float
    y_m: float
    yaw_rad: float = 0.0


class Route(Spec):
    """Places to go to one after the other, as a scenario may ask for by name.

    Attributes:
        name: Unique in the world.
        points_m: At least one (x, y), in the frame of the source.
    """

    name: str
    points_m: tuple[tuple[float, float], ...]


MOST_WALK_PLACES = 10_000


class RecordedWalk(Spec):
    """How somebody walked, which people of an episode may do again.

    Attributes:
        name: Unique in the world.
        times_s: When it was at each place, ascending, from the episode's beginning; before the first it stands there.
        points_m: The places (x, y), in the frame of the source; it goes straight from one to the next.
        period_s: After so long it begins anew; none for one that stays at its last place.
    """

    name: str
    times_s: tuple[float, ...] = Field(min_length=1, max_length=MOST_WALK_PLACES)
    points_m: tuple[tuple[float, float], ...] = Field(min_length=1, max_length=MOST_WALK_PLACES)
    period_s: float | None = None

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        ordered = all(one < other for one, other in pairwise(self.times_s)) and self.times_s[0] >= 0.0
        if not ordered or len(self.times_s) != len(self.points_m):
            raise broken("times_s: as many as points_m, ascending from 0 s or later")
        if self.period_s is not None and self.period_s <= 0.0:
            raise broken("period_s: above 0, or null")
        return self


MOST_ZONE_CORNERS = 256


class FloorZone(Spec):
    """A part of the floor of an imported world: what a room is there, of any outline.

    Attributes:
        name: Unique in the world.
        outline_m: Its corners (x, y) one after the other, in the frame of the source.
        found: Whether it was found where the floor narrows; else somebody named it.
    """

    name: str
    outline_m: tuple[tuple[float, float], ...] = Field(min_length=3, max_length=MOST_ZONE_CORNERS)
    found: bool

    @model_validator(mode="after")
    def _check_outline(self) -> Self:
        if self.area_m2 <= 0.0:
            raise broken("outline_m: corners that have floor between them")
        return self

    @property
    def floor(self) -> Rectangle:
        """The rectangle around it."""
        x_m, y_m = zip(*self.outline_m, strict=True)
        return Rectangle(x_min_m=min(x_m), y_min_m=min(y_m), x_max_m=max(x_m), y_max_m=max(y_m))

    @property
    def area_m2(self) -> float:
        """How much floor there is within its outline (shoelace formula)."""
        sides = pairwise([*self.outline_m, self.outline_m[0]])
        return abs(sum(ax * by - ay * bx for (ax, ay), (bx, by) in sides)) / 2

    def holds(self, x_m: "np.ndarray", y_m: "np.ndarray") -> "np.ndarray":
        """Returns which points lie in it: those whose way to the right crosses its outline an odd number of times."""
        around = self.floor
        held = (x_m >= around.x_min_m) & (x_m <= around.x_max_m) & (y_m >= around.y_min_m) & (y_m <= around.y_max_m)
        x, y = x_m[held], y_m[held]  # few of a whole building's, which are compared with each side
        crossings = (
            ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
            for (ax, ay), (bx, by) in pairwise([*self.outline_m, self.outline_m[0]])
            if ay != by
        )
        held[held] = reduce(operator.xor, crossings)
        return held


class WorldSource(Spec):
    """What an imported world was made from.

    Attributes:
        kind: A Gazebo world (SDF), a map of ROS, a MuJoCo scene (MJCF), or a mesh.
        file: The file's name, without folders.
        digest: SHA-256 over all that was read: the file, models, meshes and images, by name; lower-case hex.
        settings: What was asked for beside the file, such as ``wallHeight=2.5``, in order of names.
    """

    kind: Literal["sdf", "map", "mjcf", "mesh"]
    file: str
    digest: str
    settings: tuple[str, ...] = ()


class ImportFinding(Spec):
    """One part of a source that is not in the world exactly as it was.

    Attributes:
        subject: Which part, by its names in the source, such as ``table/link/collision``.
        became: Approximated by upright solids, left out, or not found.
        why: For a person: what it is, and where it was looked for.
        off_m: How far surfaces moved at most, where that is known.
    """

    subject: str
    became: Literal["approximated", "dropped", "unresolved"]
    why: str
    off_m: float | None = None


_SAME_PLACE = 0.5


class MapAgreement(Spec):
    """How an imported world agrees with a map of the same place.

    Attributes:
        map: The map's file, from the folder that it was found from.
        height_m: Height at which the world was cut: of those of lidars, the one at which both agree best.
        within_5cm: Share of the map's occupied border cells with a surface of the world within 5 cm, 0-1.
        mean_m: Mean distance from these cells to the nearest surface.
        free_iou: Free floor of both over free floor of either, of what hangs together, 0-1.
        moved: How the map had to be moved for that, turned first; None where it agrees, or not, as it lies.
    """

    map: str
    height_m: float
    within_5cm: float
    mean_m: float
    free_iou: float
    moved: Start | None = None

    @property
    def same_place(self) -> bool:
        """Returns whether both are of one place: a third of a border is near to something by chance."""
        return self.within_5cm >= _SAME_PLACE


class ImportReport(Spec):
    """What became of a source's parts: an imported world has this in place of wishes.

    Attributes:
        parts: How many parts the source has that a robot could meet.
        exact: How many of them are in the world as they were.
        findings: All others.
        agreements: With the maps that lay beside the source.
    """

    parts: int
    exact: int
    findings: tuple[ImportFinding, ...] = ()
    agreements: tuple[MapAgreement, ...] = ()


class World(Spec):
    """One apartment, or an imported building.

    Attributes:
        version: Version of this format: 2 where anything that version 1 has not is used.
        generator: The generator's name and version; another one may make another world of the same seed.
        template_digest: Of the template that it was generated from; empty for an imported world, as its seed and
            indices are 0.
        sub_seed: How many tries were given up before this world kept its guarantees.
        generation: Name of the generation job; with ``name`` it identifies the world in a store.
        name: Name of the world in its job, such as ``world-3-1`` (floor plan 3, interior 1; both from 1).
        footprint: Outer faces of the outer walls.
        start: Where the robot starts; none for the origin, without a turn.
        source: What it was imported from; none for a generated world.
        report: What became of the source's parts.
        routes: Ways that came with the source, or named places: routes of one point.
        zones: Parts of its floor that came with the source, or were found; not in a world that has rooms.
        walks: How people walked in the source.
    """

    version: Literal["1", "2"] = "1"
    generator: str
    template_digest: str
    seed: int
    sub_seed: int = 0
    generation: str
    name: str
    floorplan_index: int
    interior_index: int
    ceiling_height_m: float
    wall_thickness_m: float
    footprint: Rectangle
    rooms: tuple[Room, ...]
    passages: tuple[Passage, ...]
    walls: tuple[Solid, ...]
    doors: tuple[Door, ...] = ()
    windows: tuple[Window, ...] = ()
    furniture: tuple[Furniture, ...]
    lights: tuple[Light, ...]
    map: OccupancyMap
    certificate: Certificate
    start: Start | None = _later
    source: WorldSource | None = _later
    report: ImportReport | None = _later
    routes: tuple[Route, ...] | None = _later
    zones: tuple[FloorZone, ...] | None = _later
    walks: tuple[RecordedWalk, ...] | None = _later

    @property
    def areas(self) -> "tuple[Room, ...] | tuple[FloorZone, ...]":
        """What a robot is sent to: its rooms, or its zones; none of an open floor."""
        return self.rooms or self.zones or ()

    @model_validator(mode="after")
    def _check_version(self) -> Self:
        if self.version == "1":
            names = ("start", "source", "report", "routes", "zones", "walks")
            later = [name for name in names if getattr(self, name) is not None]
            if later or any(solid.shape == "prism" for solid in solids(self)):
                raise broken(f'version "{WORLD_VERSION}" for {" and ".join(later or ["prisms"])}')
        return self


def start_pose(world: World) -> Start:
    """Returns where a robot starts in a world."""
    return world.start or Start(x_m=0.0, y_m=0.0)


def below_heads(pieces: Sequence[Furniture]) -> list[Furniture]:
    """Returns pieces as one who looks down on the floor wants them: without roofs, lamps and all that hangs so high."""
    low = [
        piece.model_copy(update={"solids": tuple(each for each in piece.solids if _bottom_m(each) < OVERHEAD_M)})
        for piece in pieces
    ]
    return [piece for piece in low if piece.solids]


def _bottom_m(solid: Solid) -> float:
    return solid.center_m[2] - solid.half_extents_m[2]


def solids(world: World) -> tuple[Solid, ...]:
    """Returns all solids of a world: walls, then doors as they stand, then furniture, in document order."""
    leaves = tuple(door.leaf for door in world.doors)
    return world.walls + leaves + tuple(solid for piece in world.furniture for solid in piece.solids)
