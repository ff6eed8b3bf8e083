"""The process that renders: worlds in, cut open to look into, pixels out; for a film, a scene and poses in.

Run as ``python -m tasks.export.picture.render_process worlds|film WIDTH HEIGHT SAMPLES``.

MUJOCO_GL says which GL it takes. It says so when that works, and then answers each line of its standard input, a
caption and a world as JSON, with the pixels of its picture: rows from the top, three bytes each. A process of its own,
because a GL that does not work may end the interpreter (docs/reference/rendering.md, section 1).

One light cannot light a room without ceiling well: straight shadows, and black where none falls. A picture is the mean
of many, each lit from another direction of the sky or of the sun's disc, and each shifted by a part of a pixel: soft
shadows, darker corners and smooth edges, all by MuJoCo's own shadow maps.

For a film such a picture is made once, without the robot. What the robot covers is found out by rendering the scene
plainly with it and without it, in a tenth of the time and less.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

import mujoco
import numpy as np
from jaxtyping import Float, Float64

from specs.data.mover_colors import BOX, NOSE, OTHER, PERSON, ROBOT
from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from specs.data.world import Color, Solid, Window, World, below_heads
from tasks.export.format.mjcf import world_spec
from tasks.export.picture.renderer import CAPTION_LINE, REQUEST, FilmScene, Pixels
from tasks.render.camera_renderer import say_ready
from tasks.render.camera_scene import add_parts
from tasks.render.sheets import WINDOW_PREFIX

CUT_COLOR: Color = (0.93, 0.92, 0.90)
_SMALLEST_M = 0.005


def cut_open(world: World, height_m: float) -> World:
    """Returns the world without what of its walls, doors and windows is above a height, and without a roof.

    Furniture stays whole, up to what hangs above all heads.
    """
    windows = [window for window in world.windows if window.bottom_m < height_m]
    lowered = [wall for each in world.walls if (wall := _lowered(each, height_m))]
    walls = tuple(part.model_copy(update={"color": CUT_COLOR}) for wall in lowered for part in _pierced(wall, windows))
    return world.model_copy(
        update={
            "walls": walls,
            "furniture": tuple(below_heads(world.furniture)),
            "doors": tuple(
                door.model_copy(update={"leaf": _lowered(door.leaf, height_m) or door.leaf}) for door in world.doors
            ),
            "windows": tuple(window.model_copy(update={"top_m": min(window.top_m, height_m)}) for window in windows),
            "ceiling_height_m": min(world.ceiling_height_m, height_m),
        }
    )


def _lowered(solid: Solid, height_m: float) -> Solid | None:
    bottom_m = solid.center_m[2] - solid.half_extents_m[2]
    top_m = min(height_m, solid.center_m[2] + solid.half_extents_m[2])
    return _part(solid, 2, bottom_m, top_m) if top_m - bottom_m > _SMALLEST_M else None


def _pierced(wall: Solid, windows: Sequence[Window]) -> Iterator[Solid]:
    """Yields what of a wall is left beside, below and above its windows."""
    window = next((window for window in windows if _is_in(window, wall)), None)
    if window is None:
        yield wall
        return
    along = 0 if window.along == "x" else 1
    start_m, end_m = window.center_m[along] - window.width_m / 2, window.center_m[along] + window.width_m / 2
    low_m, high_m = wall.center_m[along] - wall.half_extents_m[along], wall.center_m[along] + wall.half_extents_m[along]
    others = [other for other in windows if other != window]
    for name, from_m, to_m in (("first", low_m, start_m), ("last", end_m, high_m)):
        if to_m - from_m > _SMALLEST_M:
            yield from _pierced(_part(wall, along, from_m, to_m, name), others)
    pillar = _part(wall, along, start_m, end_m)
    bottom_m, top_m = wall.center_m[2] - wall.half_extents_m[2], wall.center_m[2] + wall.half_extents_m[2]
    for name, from_m, to_m in (("sill", bottom_m, window.bottom_m), ("head", window.top_m, top_m)):
        if to_m - from_m > _SMALLEST_M:
            yield _part(pillar, 2, from_m, to_m, name)


def _is_in(window: Window, wall: Solid) -> bool:
    along, across = (0, 1) if window.along == "x" else (1, 0)
    beside_m = abs(window.center_m[across] - wall.center_m[across])
    inside_m = wall.half_extents_m[along] - abs(window.center_m[along] - wall.center_m[along])
    return beside_m < wall.half_extents_m[across] and inside_m > window.width_m / 2 - _SMALLEST_M


def _part(solid: Solid, axis: int, from_m: float, to_m: float, name: str = "") -> Solid:
    """Returns the part of a straight solid between two places on an axis."""
    center_m, half_extents_m = list(solid.center_m), list(solid.half_extents_m)
    center_m[axis], half_extents_m[axis] = (from_m + to_m) / 2, (to_m - from_m) / 2
    update = {"center_m": tuple(center_m), "half_extents_m": tuple(half_extents_m)}
    return solid.model_copy(update={**update, "name": f"{solid.name}/{name}" if name else solid.name})


CUT_M = 1.45  # above tables and sills, below heads: one looks into every room over its walls
_FOVY_RAD = math.radians(28.0)
_ELEVATION_RAD = math.radians(58.0)
_AZIMUTH_RAD = math.radians(72.0)  # from the south, a little from the west, so that two faces of everything are seen
_MARGIN = 1.08
_SUN_FROM_CAMERA_RAD, _SUN_HEIGHT_RAD, _SUN_SIZE, _SKY_SIZE = math.radians(150.0), math.radians(54.0), 0.12, 0.86
_GOLDEN_ANGLE_RAD = math.pi * (3.0 - math.sqrt(5.0))
# Steps of a sequence that fills the unit square evenly (Roberts' R2).
_SHIFT_STEPS = (0.7548776662466927, 0.5698402909980532)
_AMBIENT, _DIFFUSE, _HEADLIGHT = 0.44, 0.60, 0.16
_EXPOSURE, _GAMMA = 1.035, 0.86
_GROUND_RGBA, _PANE_ALPHA = (1.0, 1.0, 1.0, 1.0), 0.5
_GROUND_MARGIN_M = 1.5
# Where a line's text is placed, in rows below the line's top: MuJoCo counts to the lower edge of its letters' boxes.
_HEADING, _LINE = (mujoco.mjtFont.mjFONT_BIG, 33), (mujoco.mjtFont.mjFONT_NORMAL, 22)
_TEXT_RGB = (0.15, 0.17, 0.19)


@dataclass(frozen=True)
class CameraView:
    """Where the camera is.

    Attributes:
        target_m: What it looks at.
        distance_m: How far that is away.
        azimuth_rad: Where it looks, from the x axis.
    """

    target_m: Float64[np.ndarray, "3"]
    distance_m: float
    azimuth_rad: float

    @property
    def axes(self) -> Float64[np.ndarray, "3 3"]:
        """Returns the unit vectors to the right, up and forwards."""
        cos, sin = math.cos(self.azimuth_rad), math.sin(self.azimuth_rad)
        forwards = np.array([cos * math.cos(_ELEVATION_RAD), sin * math.cos(_ELEVATION_RAD), -math.sin(_ELEVATION_RAD)])
        right = np.array([sin, -cos, 0.0])
        return np.stack([right, np.cross(right, forwards), forwards])


def render_worlds(width: int, height: int, samples: int, worlds: BinaryIO, pictures: BinaryIO) -> None:
    """Renders world after world until there are no more.

    Args:
        width: Of a picture, in pixels.
        height: Of a picture, in pixels.
        samples: Samples a pixel.
        worlds: The worlds' documents.
        pictures: Where the pictures go.
    """
    for line in worlds:
        caption, world = REQUEST.validate_json(line)
        below = draw_caption(caption, width)
        picture = render(world, width, height - len(below), samples)
        pictures.write(np.concatenate([picture, below]).tobytes())
        pictures.flush()


def render(world: World, width: int, height: int, samples: int) -> Pixels:
    """Returns a picture of a world cut open; a GL context is current.

    Args:
        world: What is shown.
        width: Of the picture, in pixels.
        height: Of the picture, in pixels.
        samples: Samples a pixel.
    """
    return photograph(world_spec(cut_open(world, CUT_M)), whole_view(world, width / height), width, height, samples)


def photograph(spec: mujoco.MjSpec, view: CameraView, width: int, height: int, samples: int) -> Pixels:
    """Returns a picture of a model that has a world's ground and sky; a GL context is current.

    Args:
        spec: The model.
        view: Where the camera is.
        width: Of the picture, in pixels.
        height: Of the picture, in pixels.
        samples: Samples a pixel.
    """
    model = lit_model(spec, width, height)
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 100)
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    area = mujoco.MjrRect(0, 0, width, height)
    pixels = np.empty((height, width, 3), np.uint8)
    light = np.zeros((height, width, 3), np.uint32)
    for camera, direction in views(view, samples, height):
        model.light_dir[0] = -direction
        model.light_pos[0] = view.target_m + direction * view.distance_m
        mujoco.mj_forward(model, data)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, int(mujoco.mjtCatBit.mjCAT_ALL), scene)
        mujoco.mjr_render(area, scene, context)
        mujoco.mjr_readPixels(pixels, None, area, context)
        light += pixels
    context.free()
    share = (light[::-1] / (255.0 * samples)) ** _GAMMA * _EXPOSURE
    return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def draw_caption(lines: Sequence[str], width: int) -> Pixels:
    """Returns lines of text, black on white, the first one larger; what is not ASCII is left out."""
    height = CAPTION_LINE * len(lines)
    pixels = np.full((height, width, 3), 255, np.uint8)
    if not lines:
        return pixels
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    context = mujoco.MjrContext(spec.compile(), mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    area = mujoco.MjrRect(0, 0, width, height)
    mujoco.mjr_rectangle(area, 1.0, 1.0, 1.0, 1.0)
    for number, line in enumerate(lines):
        font, below = _HEADING if number == 0 else _LINE
        text = line.encode("ascii", "ignore").decode()
        y = 1.0 - (CAPTION_LINE * number + below) / height
        mujoco.mjr_text(font, text, context, 8.0 / width, y, *_TEXT_RGB)
    mujoco.mjr_readPixels(pixels, None, area, context)
    context.free()
    return pixels[::-1]


def whole_view(world: World, aspect: float) -> CameraView:
    """Returns the view in which the whole apartment just fits into a picture; long ones lie across it."""
    area = world.footprint
    deep = area.y_max_m - area.y_min_m > 1.4 * (area.x_max_m - area.x_min_m)
    azimuth_rad = _AZIMUTH_RAD + (math.pi / 2 if deep and aspect > 1.0 else 0.0)
    corners = np.array(
        [(x, y, z) for x in (area.x_min_m, area.x_max_m) for y in (area.y_min_m, area.y_max_m) for z in (0.0, CUT_M)]
    )
    view = CameraView(corners.mean(axis=0), 10.0, azimuth_rad)
    half_height = math.tan(_FOVY_RAD / 2)
    for _ in range(4):  # perspective makes each step an estimate; the fourth moves nothing by a pixel
        seen = (corners - view.target_m) @ view.axes.T
        depth_m = seen[:, 2] + view.distance_m
        spread = seen[:, :2] / depth_m[:, None] / (half_height * aspect, half_height)
        low, high = spread.min(axis=0), spread.max(axis=0)
        shift = (low + high) / 2 * (half_height * aspect, half_height) * view.distance_m
        grown = float(max(high - low)) / 2 * _MARGIN
        view = CameraView(view.target_m + shift @ view.axes[:2], view.distance_m * grown, azimuth_rad)
    return view


def lit_model(spec: mujoco.MjSpec, width: int, height: int) -> mujoco.MjModel:
    """Returns a model that has a world's ground and sky with a single lamp, and the field of view of all pictures."""
    for light in list(spec.lights):
        spec.delete(light)
    lamp = spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=True)
    lamp.diffuse, lamp.specular = [_DIFFUSE] * 3, [0.0] * 3
    spec.visual.headlight.ambient = [_AMBIENT] * 3
    spec.visual.headlight.diffuse = [_HEADLIGHT] * 3
    spec.visual.global_.fovy = math.degrees(_FOVY_RAD)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 0
    spec.visual.map.znear, spec.visual.map.zfar = 0.05, 20.0
    # The shadow map covers the ground, and that a shadow's length around the apartment: its pixels are few.
    spec.stat.extent += _GROUND_MARGIN_M
    sky = spec.texture("sky")
    sky.rgb1 = sky.rgb2 = [1.0, 1.0, 1.0]
    ground = spec.geoms[0]  # the first geom of every world; its name is another where a solid is called ground
    ground.rgba = list(_GROUND_RGBA)
    ground.size = [half_m + _GROUND_MARGIN_M for half_m in ground.size[:2]] + [1.0]
    for geom in spec.geoms:
        if geom.name.startswith(WINDOW_PREFIX) and geom.name.endswith("/pane"):
            geom.rgba = [*geom.rgba[:3], _PANE_ALPHA]
    return spec.compile()


def views(view: CameraView, count: int, height: int) -> Iterator[tuple[mujoco.MjvCamera, Float64[np.ndarray, "3"]]]:
    """Yields cameras, each shifted by another part of a pixel, and directions to the light: sky and sun in turn."""
    right, up, _ = view.axes
    pixel_m = 2.0 * view.distance_m * math.tan(_FOVY_RAD / 2) / height
    for number in range(count):
        shift = [(number * step) % 1.0 - 0.5 for step in _SHIFT_STEPS]
        camera = mujoco.MjvCamera()
        camera.lookat = view.target_m + pixel_m * (shift[0] * right + shift[1] * up)
        camera.distance, camera.azimuth = view.distance_m, math.degrees(view.azimuth_rad)
        camera.elevation = -math.degrees(_ELEVATION_RAD)
        yield camera, _to_light(number // 2, (count + 1) // 2, view.azimuth_rad, sun=number % 2 == 1)


def _to_light(number: int, count: int, azimuth_rad: float, *, sun: bool) -> Float[np.ndarray, "3"]:
    """Returns one of ``count`` directions: of the sun's disc, or of the sky, more from above than from the side."""
    radius = math.sqrt((number + 0.5) / count) * (_SUN_SIZE if sun else _SKY_SIZE)
    angle_rad = number * _GOLDEN_ANGLE_RAD
    x, y = radius * math.cos(angle_rad), radius * math.sin(angle_rad)
    if not sun:
        return np.array([x, y, math.sqrt(1.0 - radius * radius)])
    around_rad = azimuth_rad + _SUN_FROM_CAMERA_RAD
    cos, sin = math.cos(_SUN_HEIGHT_RAD), math.sin(_SUN_HEIGHT_RAD)
    middle = np.array([cos * math.cos(around_rad), cos * math.sin(around_rad), sin])
    aside = np.array([-math.sin(around_rad), math.cos(around_rad), 0.0])
    found = middle + x * aside + y * np.cross(middle, aside)
    return found / np.linalg.norm(found)


_HULL, _NOSE, _PERSON, _BOX, _ROBOT = ((*each.shares, 1.0) for each in (ROBOT, NOSE, PERSON, BOX, OTHER))
_AWAY_M = -1e3
_GOT = b"!"


def film(width: int, height: int, samples: int, asked: BinaryIO, pictures: BinaryIO) -> None:
    """Films one scene until there are no more poses.

    Args:
        width: Of a picture, in pixels.
        height: Of a picture, in pixels.
        samples: Samples a pixel.
        asked: The scene, then a pose a line, with the places of people and of other robots behind it.
        pictures: Where the pictures go.
    """
    stage = _FilmStage(FilmScene.model_validate_json(asked.readline()), width, height, samples)
    pictures.write(_GOT)
    pictures.flush()
    for line in asked:
        x, y, yaw, *movers = map(float, line.split())
        pictures.write(stage.picture((x, y, yaw), np.reshape(movers, (-1, 2))).tobytes())
        pictures.flush()


class _FilmStage:
    """A scene that was rendered well without its robot; a GL context is current."""

    def __init__(self, scene: FilmScene, width: int, height: int, samples: int) -> None:
        self._ground = render(scene.world, width, height, samples)
        self._model = lit_model(_with_robot(scene), width, height)
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + 100)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._area = mujoco.MjrRect(0, 0, width, height)
        view = whole_view(scene.world, width / height)
        self._camera, toward = next(views(view, 1, height))
        self._model.light_dir[0], self._model.light_pos[0] = -toward, view.target_m + toward * view.distance_m
        self._middles_m = np.array(
            [PERSON_HEIGHT_M / 2] * scene.people
            + [(scene.low_m + scene.high_m) / 2] * scene.robots
            + [size_m[2] / 2 for size_m in scene.boxes]
        )
        away = np.zeros((len(self._middles_m), 2))
        self._empty = self._plain((0.0, 0.0, 0.0), away, _AWAY_M)

    def picture(self, pose: tuple[float, float, float], movers_m: Float64[np.ndarray, "movers 2"]) -> Pixels:
        """Returns the scene with the robot at a pose, and people, other robots and boxes at their places."""
        seen = self._plain(pose, movers_m, 0.0)
        covered = (seen != self._empty).any(axis=2)
        return np.where(covered[:, :, None], seen, self._ground)

    def _plain(self, pose: tuple[float, float, float], movers_m: Float64[np.ndarray, "movers 2"], z: float) -> Pixels:
        x, y, yaw = pose
        self._data.mocap_pos[0] = x, y, z
        self._data.mocap_pos[1:, :2], self._data.mocap_pos[1:, 2] = movers_m, z + self._middles_m
        self._data.mocap_quat[0] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        mujoco.mj_forward(self._model, self._data)
        kinds = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(self._model, self._data, mujoco.MjvOption(), None, self._camera, kinds, self._scene)
        pixels = np.empty((self._area.height, self._area.width, 3), np.uint8)
        mujoco.mjr_render(self._area, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, self._area, self._context)
        return pixels[::-1]


def _with_robot(scene: FilmScene) -> mujoco.MjSpec:
    """Returns the world cut open, with a robot that stands where it is put, a bar above it ahead, and who moves."""
    spec = world_spec(cut_open(scene.world, CUT_M))
    body = spec.worldbody.add_body(name="filmed-robot", mocap=True)
    half, middle = (scene.high_m - scene.low_m) / 2, (scene.high_m + scene.low_m) / 2
    if not scene.shape:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[scene.radius_m, half, 0.0], pos=[0.0, 0.0, middle], rgba=_HULL
        )
    add_parts(spec, body, scene.shape)
    reach = scene.radius_m / 2
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[reach, 0.1 * scene.radius_m, 0.02],
        pos=[reach, 0.0, scene.high_m + 0.02],
        rgba=_NOSE,
    )
    for number in range(scene.people):
        person = spec.worldbody.add_body(name=f"filmed-person-{number}", mocap=True)
        size = [PERSON_RADIUS_M, PERSON_HEIGHT_M / 2, 0.0]
        person.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, rgba=_PERSON)
    for number in range(scene.robots):
        other = spec.worldbody.add_body(name=f"filmed-robot-{number}", mocap=True)
        other.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[scene.radius_m, half, 0.0], rgba=_ROBOT)
    for number, size_m in enumerate(scene.boxes):
        box = spec.worldbody.add_body(name=f"filmed-box-{number}", mocap=True)
        box.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[side / 2 for side in size_m], rgba=_BOX)
    return spec


def main() -> None:
    """Draws what the command line asks for, from standard input to standard output."""
    what, *numbers = sys.argv[1:]
    width, height, samples = map(int, numbers)
    context = say_ready(width, height)
    if what == "film":
        film(width, height, samples, sys.stdin.buffer, sys.stdout.buffer)
    else:
        render_worlds(width, height, samples, sys.stdin.buffer, sys.stdout.buffer)
    context.free()


if __name__ == "__main__":
    main()
