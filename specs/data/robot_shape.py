"""What a robot looks like at rest, part by part: for pictures of it."""

from typing import Literal

from specs.base import Spec

Point = tuple[float, float, float]
PartKind = Literal["sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh"]


class RobotPart(Spec):
    """A geom of a robot's MJCF that is seen, as it stands at the start, in the frame of the base on the floor.

    Attributes:
        kind: MuJoCo's name of its shape.
        size: Its half sizes, as MJCF has them; of a mesh nothing.
        position_m: Of its middle; z is above the floor.
        turn: Its quaternion (w, x, y, z).
        color: Red, green, blue and opacity, 0-1.
        outline_m: The corners of its convex outline, seen from above.
        top_m: Where it ends above the floor.
        vertices_m: Of a mesh, in its own frame.
    """

    kind: PartKind
    size: Point
    position_m: Point
    turn: tuple[float, float, float, float]
    color: tuple[float, float, float, float]
    outline_m: tuple[tuple[float, float], ...]
    top_m: float
    vertices_m: tuple[Point, ...] = ()
