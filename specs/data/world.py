"""A world is data: one canonical JSON document that everything downstream reads.

Metres, radians, z up. The origin is where the robot starts: the floor is at z = 0 and a disc of 1 m radius around
(0, 0) is free (docs/reference/robomaker.md, section 5).
"""

from typing import Literal

from specs.base import Spec

WORLD_VERSION = "1"

ROBOT_RADIUS_M = 0.25
"""Radius of the robot that worlds are passable for unless somebody asks for another: common indoor bases have less."""

RoomType = Literal["Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet"]
Color = tuple[float, float, float]
"""sRGB, each 0-1."""
Pattern = Literal["plain", "fibres", "planks", "parquet", "tiles", "bricks", "stones", "panels", "stripes"]


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
        shape: A box, or an upright cylinder whose radius is both of the first two half extents.
        center_m: Centre (x, y, z).
        half_extents_m: Half sizes along the solid's own axes (x, y, z), all positive.
        yaw_rad: Turn about z, counter-clockwise; 0 for cylinders.
        color: sRGB, each 0-1.
    """

    name: str
    shape: Literal["box", "cylinder"]
    center_m: tuple[float, float, float]
    half_extents_m: tuple[float, float, float]
    yaw_rad: float
    color: Color


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
    """One piece of furniture: a name, what it is, where it stands, and its primitives."""

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


class World(Spec):
    """One apartment.

    Attributes:
        version: Version of this format.
        generator: The generator's name and version; another one may make another world of the same seed.
        sub_seed: How many tries were given up before this world kept its guarantees.
        generation: Name of the generation job; with ``name`` it identifies the world in a store.
        name: Name of the world in its job, such as ``world-3-1`` (floor plan 3, interior 1; both from 1).
        footprint: Outer faces of the outer walls.
    """

    version: Literal["1"] = WORLD_VERSION
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


def solids(world: World) -> tuple[Solid, ...]:
    """Returns all solids of a world: walls, then doors as they stand, then furniture, in document order."""
    leaves = tuple(door.leaf for door in world.doors)
    return world.walls + leaves + tuple(solid for piece in world.furniture for solid in piece.solids)
