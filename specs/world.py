"""A world is data: one canonical JSON document that everything downstream reads.

Metres, radians, z up. The origin is where the robot starts: the floor is at z = 0 and a disc of 1 m radius around
(0, 0) is free (semantics 5).
"""

from typing import Literal

from specs.base import Spec

WORLD_VERSION = "1"

RoomType = Literal["Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet"]


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
    color: tuple[float, float, float]


class Room(Spec):
    """One room: the inner floor area between its walls' faces."""

    name: str
    type: RoomType
    floor: Rectangle
    floor_material: str
    floor_color: tuple[float, float, float]
    wall_material: str


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


class Certificate(Spec):
    """What is guaranteed about a world, measured on the finished geometry, and what the template wished in vain.

    Attributes:
        origin_clear_radius_m: Distance from (0, 0) to the nearest solid below robot height; at least 1.
        reachable_robot_radius_m: Largest robot radius with which every room is reached from the origin.
        narrowest_passage_m: Clear width of the narrowest passage.
        free_floor_share: Floor not covered by furniture, over all floor, 0-1.
        area_error_mean: Mean over rooms of |area - desired| / desired.
        overlaps: Pairs of furniture pieces or of furniture and walls that intersect; 0.
        unmet: Wishes of the template that the world does not fulfil, one sentence each.
    """

    origin_clear_radius_m: float
    reachable_robot_radius_m: float
    narrowest_passage_m: float
    free_floor_share: float
    area_error_mean: float
    overlaps: int
    unmet: tuple[str, ...]


class World(Spec):
    """One apartment.

    Attributes:
        version: Version of this format.
        generation: Name of the generation job; with ``name`` it identifies the world in a store.
        name: Name of the world in its job, such as ``world-3-1`` (floor plan 3, interior 1; both from 1).
        footprint: Outer faces of the outer walls.
    """

    version: Literal["1"] = WORLD_VERSION
    generator: str
    template_digest: str
    seed: int
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
    furniture: tuple[Furniture, ...]
    lights: tuple[Light, ...]
    certificate: Certificate


def solids(world: World) -> tuple[Solid, ...]:
    """Returns all solids of a world: walls, then furniture, in document order."""
    return world.walls + tuple(solid for piece in world.furniture for solid in piece.solids)
