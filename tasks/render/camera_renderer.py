"""Cameras on robots, drawn by MuJoCo's renderer: colour pictures, depth, and which solid each pixel shows.

A world stands still, so MuJoCo is asked once what is in the scene; a picture moves the camera and the lamp alone. All
chance is counted: an episode's light follows from its seed, and a picture's noise from that and the picture's number.
"""

import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, UInt8
from OpenGL import GL

from specs.bundle_files import CameraDeclaration, ColorCameraDeclaration
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from tasks.render.camera_scene import NOTHING, camera_scene, numbers_of
from tasks.render.gl_process import READY

Pixels = UInt8[np.ndarray, "rows columns 3"]
_NEAR_M = 0.01
# The lamp of a room with a light ceiling, most from above; the second is what floor and walls reflect.
_AMBIENT, _LAMP, _REFLECTED = 0.45, 0.50, 0.20
_DOWNWARDS = (0.32, 0.18, -0.93)
_LIGHT, _EXPOSURE = 0, 1
_BLUR_REACH = 3.0


def say_ready(width: int, height: int) -> mujoco.GLContext:
    """Returns a GL context, which is current, once something was drawn with it; says so, and which GL it is.

    Args:
        width: Most columns of a picture.
        height: Most rows of a picture.
    """
    context = mujoco.GLContext(width, height)
    context.make_current()
    # Some libraries only warn where there is no GL; drawing does not.
    mujoco.MjrContext(mujoco.MjSpec().compile(), mujoco.mjtFontScale.mjFONTSCALE_100).free()
    sys.stdout.buffer.write(READY + f" {gl_name()}\n".encode("ascii", "replace"))
    sys.stdout.buffer.flush()
    return context


def gl_name() -> str:
    """Returns the vendor, the name and the version of the GL whose context is current."""
    asked = (GL.GL_VENDOR, GL.GL_RENDERER, GL.GL_VERSION)
    vendor, renderer, version = ((GL.glGetString(name) or b"?").decode() for name in asked)
    return f"{vendor}, {renderer}, OpenGL {version}"


class Light(NamedTuple):
    """What a world is lit by.

    Attributes:
        color: How bright the lamp is, by channel; 1 is usual.
        direction: Where its light goes.
    """

    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    direction: tuple[float, float, float] = _DOWNWARDS


class CameraPose(NamedTuple):
    """Where a camera is, and its unit vectors ahead and up."""

    position_m: Float64[np.ndarray, "3"]
    ahead: Float64[np.ndarray, "3"]
    up: Float64[np.ndarray, "3"]


def mounted(camera: CameraDeclaration, x_m: float, y_m: float, yaw_rad: float) -> CameraPose:
    """Returns where a camera is whose robot is at a pose."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    position_m = (x_m + cos * camera.x_m - sin * camera.y_m, y_m + sin * camera.x_m + cos * camera.y_m, camera.z_m)
    cos, sin = math.cos(yaw_rad + camera.yaw_rad), math.sin(yaw_rad + camera.yaw_rad)
    level, down = math.cos(camera.pitch_rad), math.sin(camera.pitch_rad)
    return CameraPose(
        np.array(position_m), np.array([cos * level, sin * level, -down]), np.array([cos * down, sin * down, level])
    )


def focal_px(camera: CameraDeclaration) -> float:
    """Returns the focal length in pixels, the same along rows and columns; the principal point is the middle."""
    return camera.columns / 2 / math.tan(camera.fov_rad / 2)


class CameraRenderer:
    """One camera in one world; a GL context is current."""

    def __init__(self, world: World, camera: CameraDeclaration, robot: Sequence[RobotPart] = ()) -> None:
        self._camera = camera
        self._made = camera_scene(world, camera.columns, camera.rows, robot)
        self.names = self._made.names
        model = self._made.model
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._colored = _scene(model, data, (*self._made.colored, *self._made.robot))
        own = self._colored.geoms[len(self._made.colored) : self._colored.ngeom]
        self._robot = [(geom, geom.pos.copy(), geom.mat.copy()) for geom in own]
        self._numbered = _scene(model, data, (self._made.numbered,))
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._area = mujoco.MjrRect(0, 0, camera.columns, camera.rows)

    def stand(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Puts the robot at a pose, for the colour pictures that follow."""
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        for geom, place_m, turned in self._robot:
            geom.pos, geom.mat = turn @ place_m + [x_m, y_m, 0.0], turn @ turned

    def color(self, pose: CameraPose, light: Light) -> Pixels:
        """Returns what the camera sees; black where nothing is within its range."""
        _shine(self._colored, light)
        pixels = np.empty((self._camera.rows, self._camera.columns, 3), np.uint8)
        self._draw(self._colored, pose)
        mujoco.mjr_readPixels(pixels, None, self._area, self._context)
        return pixels[::-1]

    def depth_and_solids(
        self, pose: CameraPose
    ) -> tuple[Float32[np.ndarray, "rows columns"], Int32[np.ndarray, "rows columns"]]:
        """Returns how far ahead what is seen lies, metres along the camera's axis, and which of ``names`` it is.

        Where nothing is within the camera's range, the depth is that, and the number NOTHING.
        """
        shape = (self._camera.rows, self._camera.columns)
        pixels, inverse = np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32)
        self._draw(self._numbered, pose)
        mujoco.mjr_readPixels(pixels, inverse, self._area, self._context)
        # The buffer has (near / depth - near / far) / (1 - near / far): 1 nearest, 0 farthest.
        share = _NEAR_M / self._camera.range_m
        depth_m = _NEAR_M / (inverse[::-1].astype(np.float64) * (1.0 - share) + share)
        numbers = np.where(inverse[::-1] > 0.0, numbers_of(pixels[::-1]), NOTHING)
        return np.minimum(depth_m, self._camera.range_m).astype(np.float32), numbers.astype(np.int32)

    def close(self) -> None:
        """Frees what the GL keeps for it."""
        self._context.free()

    def _draw(self, scene: mujoco.MjvScene, pose: CameraPose) -> None:
        half_width_m = _NEAR_M * math.tan(self._camera.fov_rad / 2)
        half_height_m = half_width_m * self._camera.rows / self._camera.columns
        for eye in scene.camera:  # MuJoCo has two, for stereo, and draws from their middle
            eye.pos, eye.forward, eye.up = pose
            eye.orthographic, eye.frustum_center = 0, 0.0
            eye.frustum_width, eye.frustum_bottom, eye.frustum_top = half_width_m, -half_height_m, half_height_m
            eye.frustum_near, eye.frustum_far = _NEAR_M, max(self._camera.range_m, 2 * _NEAR_M)
        # Surfaces seen from behind are most of the work, and hidden, unless the camera is in a solid.
        corner_m = math.hypot(_NEAR_M, half_width_m, half_height_m)
        scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = not self._made.hulls.hold(pose.position_m, corner_m)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        mujoco.mjr_render(self._area, scene, self._context)


def _scene(model: mujoco.MjModel, data: mujoco.MjData, geoms: tuple[int, ...]) -> mujoco.MjvScene:
    """Returns a scene that shows some geoms, without shadows, reflections, sky and haze."""
    model.geom_group[:] = [0 if geom in geoms else mujoco.mjNGROUP - 1 for geom in range(model.ngeom)]
    scene = mujoco.MjvScene(model, maxgeom=model.ngeom)
    scene.flags[:] = 0
    kinds = int(mujoco.mjtCatBit.mjCAT_ALL)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), kinds, scene)
    scene.nlight = 0  # numbers shine by themselves
    return scene


def _shine(scene: mujoco.MjvScene, light: Light) -> None:
    """Puts a lamp far away into a scene, and what reflects its light."""
    scene.nlight = 2
    lamp, reflected = scene.lights[0], scene.lights[1]
    down = np.array(light.direction)
    for each, direction, share in ((lamp, down, _LAMP), (reflected, -down, _REFLECTED)):
        each.type, each.headlight, each.castshadow = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, 0, 0
        each.dir, each.diffuse = direction, share * np.array(light.color)
        each.ambient, each.specular = np.zeros(3), np.zeros(3)
    lamp.ambient = _AMBIENT * np.array(light.color)


def episode_light(camera: ColorCameraDeclaration, seed: int) -> Light:
    """Returns the light of an episode: drawn by its seed from what the camera declares."""
    rng = _counted(seed, _LIGHT, (0, 0))
    brightness, *tints, tilt, around = rng.uniform(-1.0, 1.0, 6).tolist()
    color = [(1.0 + camera.light_spread * brightness) * (1.0 + camera.tint_spread * tint) for tint in tints]
    if camera.light_tilt_rad == 0.0:
        return Light(color=(color[0], color[1], color[2]))
    tilt_rad, around_rad = camera.light_tilt_rad * abs(tilt), math.pi * around
    away = math.sin(tilt_rad)
    direction = (away * math.cos(around_rad), away * math.sin(around_rad), -math.cos(tilt_rad))
    return Light((color[0], color[1], color[2]), direction)


def exposed(pixels: Pixels, camera: ColorCameraDeclaration, seed: int, number: tuple[int, int]) -> Pixels:
    """Returns a picture as the camera takes it: blurred, exposed, with noise; as it is if none is declared.

    Args:
        pixels: What is there.
        camera: How it errs.
        seed: The episode's.
        number: The picture's, from 0, and its camera's in a list; each has its own errors.
    """
    if not (camera.blur_px or camera.exposure_spread or camera.noise):
        return pixels
    rng = _counted(seed, _EXPOSURE, number)
    taken = _blurred(pixels.astype(np.float32), camera.blur_px) if camera.blur_px else pixels.astype(np.float32)
    taken *= np.float32(1.0 + camera.exposure_spread * rng.uniform(-1.0, 1.0))
    if camera.noise:
        taken += np.float32(255.0 * camera.noise) * rng.standard_normal(pixels.shape, np.float32)
    return np.rint(np.clip(taken, 0.0, 255.0)).astype(np.uint8)


def _counted(seed: int, stream: int, number: tuple[int, int]) -> np.random.Generator:
    key = np.array([seed & (1 << 64) - 1, stream], np.uint64)  # a list of both would become floats
    return np.random.Generator(np.random.Philox(key=key, counter=[0, 0, number[1], number[0]]))


def _blurred(pixels: Float[np.ndarray, "rows columns 3"], sigma_px: float) -> Float[np.ndarray, "rows columns 3"]:
    """Returns a picture blurred by a Gaussian; beyond its edges it goes on as it is there."""
    reach = math.ceil(_BLUR_REACH * sigma_px)
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / sigma_px) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for axis in (0, 1):
        taken, places = pixels, np.arange(pixels.shape[axis])
        pixels = np.zeros_like(taken)
        for step, weight in zip(steps, weights, strict=True):
            pixels += weight * np.take(taken, np.clip(places + step, 0, len(places) - 1), axis)
    return pixels
