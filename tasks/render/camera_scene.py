"""A world as a camera on a robot sees it: a model of few meshes, which a software GL draws a thousand times a second.

What a picture costs is draw calls, multisampling and shadow maps, not pixels (docs/reference/rendering.md, section 4).
So all solids are one mesh, whatever their colours: each corner points at a dot of a picture that has a dot a colour. A
second mesh of the same triangles points at dots that number the solids: it gives depth and segmentation at once. Walls'
and floors' coverings are sheets before the solids; only colour pictures show them.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64, Int64

from specs.data.robot_shape import RobotPart
from specs.data.world import MOST_CORNERS, Color, Rectangle, Solid, World, corners_m, solids
from tasks.render.sheets import Covering, finish_key, sheets, window_parts
from tasks.render.textures import texture_of

FLOOR, CEILING = "floor", "ceiling"
NOTHING = -1
"""What a segmentation has where a camera sees no solid."""

# A cylinder is a prism that is at most so far within the circle or beyond it.
_ROUND_M = 0.0004
_FLOOR_COLOR: Color = (0.55, 0.53, 0.50)
_CEILING_COLOR: Color = (0.95, 0.95, 0.95)
_AROUND_M = 100.0  # of floor: what is seen through a gap in the outer walls
_THICKNESS_M = 0.05


class CameraScene(NamedTuple):
    """A world's model.

    Attributes:
        model: Its geoms are meshes, in the order of the two tuples.
        names: Of the solids that a segmentation numbers, from 0: the world's, the floor, and the ceiling if it has one.
        colored: Geoms of a colour picture.
        numbered: The geom of depth and segmentation, whose colours are numbers from 1.
        hulls: Of the solids.
        robot: Geoms of the robot, which stands at the origin; colour pictures show it too.
    """

    model: mujoco.MjModel
    names: tuple[str, ...]
    colored: tuple[int, ...]
    numbered: int
    hulls: "Hulls"
    robot: tuple[int, ...]


class Hulls(NamedTuple):
    """Convex outlines around solids, as sides that point outwards, and their heights; sides of no length fill up."""

    normals: Float64[np.ndarray, "solids sides 2"]
    offsets_m: Float64[np.ndarray, "solids sides"]
    low_m: Float64[np.ndarray, "solids"]
    high_m: Float64[np.ndarray, "solids"]

    def hold(self, place_m: Float64[np.ndarray, "3"], margin_m: float) -> bool:
        """Returns whether a place is in one of them, or so near to it."""
        beside = (self.normals @ place_m[:2] <= self.offsets_m + margin_m).all(axis=1)
        return bool((beside & (self.low_m - margin_m <= place_m[2]) & (place_m[2] <= self.high_m + margin_m)).any())


def _hulls(seen: Sequence[Solid]) -> Hulls:
    outlines = np.array([(corners := corners_m(each)) + corners[-1:] * (MOST_CORNERS - len(corners)) for each in seen])
    along = np.roll(outlines, -1, axis=1) - outlines
    lengths = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
    normals = np.stack([along[..., 1], -along[..., 0]], axis=2) / lengths[..., None]
    low_m, high_m = np.array([_heights_m(each) for each in seen]).T
    return Hulls(normals, (normals * outlines).sum(axis=2), low_m, high_m)


class _Mesh(NamedTuple):
    """Triangles with flat or round sides: a corner for each side that it is part of."""

    corners_m: Float64[np.ndarray, "corners 3"]
    normals: Float64[np.ndarray, "corners 3"]
    triangles: Int64[np.ndarray, "triangles 3"]


def camera_scene(world: World, width: int, height: int, robot: Sequence[RobotPart] = ()) -> CameraScene:
    """Returns the model of a world.

    Args:
        world: Any world.
        width: Most columns of a picture.
        height: Most rows of a picture.
        robot: What the camera sees of its own robot.
    """
    seen = [*solids(world), *_floor_and_ceiling(world)]
    meshes = [solid_mesh(solid) for solid in seen]
    textured, plain = _coverings(world)
    panes = [part for room in world.rooms for part in window_parts(world, room)]
    spec = _empty_spec(width, height)
    colors = [solid.color for solid in [*seen, *panes]] + [sheet.finish.color for sheet in plain]
    shown = [*meshes, *map(solid_mesh, panes), *map(_sheet_mesh, plain)]
    _add_dotted(spec, "colors", shown, np.rint(255.0 * np.array(colors)).astype(np.uint8))
    for number, same in enumerate(textured):
        _add_textured(spec, f"covering-{number}", same)
    _add_dotted(spec, "numbers", meshes, _as_colors(np.arange(1, len(seen) + 1)), emission=1.0)
    names, numbered = tuple(solid.name for solid in seen), 1 + len(textured)
    add_parts(spec, spec.worldbody, robot)
    after = numbered + 1
    own = tuple(range(after, after + len(robot)))
    return CameraScene(spec.compile(), names, tuple(range(numbered)), numbered, _hulls(seen), own)


def add_parts(spec: mujoco.MjSpec, body: mujoco.MjsBody, parts: Iterable[RobotPart]) -> None:
    """Adds what a robot looks like to a body, a geom each part."""
    for number, part in enumerate(parts):
        geom = body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{part.kind.upper()}"), rgba=part.color)
        geom.pos, geom.quat, geom.size = part.position_m, part.turn, part.size
        if part.vertices_m:
            mesh = spec.add_mesh(name=f"robot/{number}")
            mesh.uservert = np.array(part.vertices_m, dtype=np.float64).ravel()
            geom.meshname = mesh.name


def numbers_of(pixels: np.ndarray) -> np.ndarray:
    """Returns the places in ``CameraScene.names`` that a picture of the numbered geom shows; NOTHING for background."""
    red, green, blue = (pixels[..., channel].astype(np.int32) for channel in range(3))
    return (red | green << 8 | blue << 16) - 1


def _as_colors(numbers: Int64[np.ndarray, "dots"]) -> np.ndarray:
    return np.stack([numbers & 255, numbers >> 8 & 255, numbers >> 16], axis=1).astype(np.uint8)


def _floor_and_ceiling(world: World) -> list[Solid]:
    """Returns slabs that end at the floor's height, and begin at the ceiling's, which imported worlds have not."""
    area, half_m = world.footprint, _THICKNESS_M / 2
    floor = _slab(FLOOR, area, _AROUND_M, -half_m, _FLOOR_COLOR)
    if world.source is not None:
        return [floor]
    return [floor, _slab(CEILING, area, 0.0, world.ceiling_height_m + half_m, _CEILING_COLOR)]


def _slab(name: str, area: Rectangle, margin_m: float, z_m: float, color: Color) -> Solid:
    half_x_m, half_y_m = (area.x_max_m - area.x_min_m) / 2, (area.y_max_m - area.y_min_m) / 2
    return Solid(
        name=name,
        shape="box",
        center_m=(area.x_min_m + half_x_m, area.y_min_m + half_y_m, z_m),
        half_extents_m=(half_x_m + margin_m, half_y_m + margin_m, _THICKNESS_M / 2),
        yaw_rad=0.0,
        color=color,
    )


def solid_mesh(solid: Solid) -> _Mesh:
    """Returns a solid's surface: all three shapes are upright prisms, and a cylinder's side is shaded as round."""
    outline, outwards = (
        _circle(solid) if solid.shape == "cylinder" else (np.array(corners_m(solid)), None)
    )  # corners, counter-clockwise
    count, (low_m, high_m) = len(outline), _heights_m(solid)
    following = np.roll(outline, -1, axis=0)
    side = following - outline
    flat = np.stack([side[:, 1], -side[:, 0]], axis=1) / np.linalg.norm(side, axis=1)[:, None]
    first, second = (flat, flat) if outwards is None else (outwards, np.roll(outwards, -1, axis=0))
    levels = [
        (outline, low_m, first),
        (following, low_m, second),
        (following, high_m, second),
        (outline, high_m, first),
    ]
    corners = [_at(points, z_m) for points, z_m, _ in levels] + [_at(outline, low_m), _at(outline, high_m)]
    normals = [_at(normal, 0.0) for _, _, normal in levels] + [_up(count, -1.0), _up(count, 1.0)]
    one = np.arange(count)
    sides = [(one, one + count, one + 2 * count), (one, one + 2 * count, one + 3 * count)]
    fan = np.arange(1, count - 1)
    ends = [
        (np.full(count - 2, 4 * count), 4 * count + fan + 1, 4 * count + fan),
        (np.full(count - 2, 5 * count), 5 * count + fan, 5 * count + fan + 1),
    ]
    triangles = np.concatenate([np.stack(three, axis=1) for three in [*sides, *ends]])
    return _Mesh(np.concatenate(corners), np.concatenate(normals), triangles)


def _circle(solid: Solid) -> tuple[Float64[np.ndarray, "corners 2"], Float64[np.ndarray, "corners 2"]]:
    """Returns corners as far beyond a cylinder's circle as the middles of sides are within, and directions to them."""
    radius_m = solid.half_extents_m[0]
    count = max(12, math.ceil(math.pi / math.acos(1.0 - min(0.5, 2.0 * _ROUND_M / radius_m))))
    around_rad = 2.0 * math.pi * np.arange(count) / count
    outwards = np.stack([np.cos(around_rad), np.sin(around_rad)], axis=1)
    reach_m = 2.0 * radius_m / (1.0 + math.cos(math.pi / count))
    return np.array(solid.center_m[:2]) + reach_m * outwards, outwards


def _heights_m(solid: Solid) -> tuple[float, float]:
    return solid.center_m[2] - solid.half_extents_m[2], solid.center_m[2] + solid.half_extents_m[2]


def _at(points: Float64[np.ndarray, "corners 2"], z: float) -> Float64[np.ndarray, "corners 3"]:
    return np.column_stack([points, np.full(len(points), z)])


def _up(count: int, z: float) -> Float64[np.ndarray, "corners 3"]:
    return np.tile([0.0, 0.0, z], (count, 1))


def _coverings(world: World) -> tuple[list[list[Covering]], list[Covering]]:
    """Returns the coverings that have a picture, those of one finish together, and those that have a colour alone."""
    together: dict[str, list[Covering]] = {}
    plain: list[Covering] = []
    for sheet in sheets(world):
        if texture_of(sheet.finish) is None:
            plain.append(sheet)
        else:
            together.setdefault(finish_key(sheet.finish), []).append(sheet)
    return list(together.values()), plain


def _sheet_mesh(sheet: Covering) -> _Mesh:
    corners, triangles = sheet.vertices_m, sheet.triangles
    normals = np.empty_like(corners)
    one, two, three = (corners[triangles[:, place]] for place in range(3))
    across = np.cross(two - one, three - one)
    normals[triangles] = (across / np.linalg.norm(across, axis=1)[:, None])[:, None]
    return _Mesh(corners, normals, triangles)


def _empty_spec(width: int, height: int) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = spec.visual.quality.shadowsize = 0
    return spec


def _add_dotted(
    spec: mujoco.MjSpec, name: str, meshes: Sequence[_Mesh], dots: np.ndarray, *, emission: float = 0.0
) -> None:
    """Adds meshes as one geom, each of the colour of its dot."""
    side = 1 << math.ceil(math.log2(math.sqrt(len(dots))))
    picture = np.zeros((side * side, 3), np.uint8)
    picture[: len(dots)] = dots
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.width, texture.height, texture.nchannel, texture.data = side, side, 3, picture.tobytes()
    places = np.arange(len(dots))
    middles = (np.stack([places % side, places // side], axis=1) + 0.5) / side
    counts = [len(mesh.corners_m) for mesh in meshes]
    _add_geom(spec, name, meshes, np.repeat(middles, counts, axis=0)).emission = emission


def _add_textured(spec: mujoco.MjSpec, name: str, same: Sequence[Covering]) -> None:
    """Adds coverings of one finish as one geom."""
    texture = texture_of(same[0].finish)
    if texture is None:
        raise ValueError(f"{same[0].finish.material} has no picture")
    file = f"{name}.png"
    spec.assets = {**spec.assets, file: texture.png}
    spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=file)
    _add_geom(spec, name, list(map(_sheet_mesh, same)), np.concatenate([sheet.coordinates for sheet in same]))


def _add_geom(
    spec: mujoco.MjSpec, name: str, meshes: Iterable[_Mesh], coordinates: Float64[np.ndarray, "corners 2"]
) -> mujoco.MjsMaterial:
    """Returns the new material of a new geom, white, so that its texture's colours are what is seen."""
    every = list(meshes)
    firsts = np.cumsum([0, *(len(each.corners_m) for each in every[:-1])])
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = np.concatenate([each.corners_m for each in every]).ravel()
    mesh.usernormal = np.concatenate([each.normals for each in every]).ravel()
    mesh.usertexcoord = coordinates.ravel()
    mesh.userface = np.concatenate([each.triangles + first for each, first in zip(every, firsts, strict=True)]).ravel()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name)
    geom.contype = geom.conaffinity = 0
    return material
