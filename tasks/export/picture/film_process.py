"""The process that films: a scene, then poses in, pixels out.

Run as ``python -m tasks.export.picture.film_process WIDTH HEIGHT SAMPLES``.

A picture with soft shadows takes many renderings (``render_process``); it is made once, without the robot. What the
robot covers is found out by rendering the scene plainly with it and without it, in a tenth of the time and less.
"""

import math
import sys
from typing import BinaryIO

import mujoco
import numpy as np

from tasks.export.format.mjcf import world_spec
from tasks.export.picture.render_process import CUT_M, cut_open, gl_that_works, lit_model, render, views, whole_view
from tasks.export.picture.renderer import READY, FilmScene, Pixels

_HULL, _NOSE = (0.98, 0.67, 0.0, 1.0), (0.13, 0.13, 0.14, 1.0)
_AWAY_M = -1e3
_GOT = b"!"


def main(width: int, height: int, samples: int, asked: BinaryIO, pictures: BinaryIO) -> None:
    """Films one scene until there are no more poses.

    Args:
        width: Of a picture, in pixels.
        height: Of a picture, in pixels.
        samples: Samples a pixel.
        asked: The scene, then the poses.
        pictures: Where the pictures go.
    """
    context = gl_that_works(width, height)
    pictures.write(READY)
    pictures.flush()
    stage = _Stage(FilmScene.model_validate_json(asked.readline()), width, height, samples)
    pictures.write(_GOT)
    pictures.flush()
    for line in asked:
        x, y, yaw = map(float, line.split())
        pictures.write(stage.picture(x, y, yaw).tobytes())
        pictures.flush()
    context.free()


class _Stage:
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
        self._empty = self._plain(0.0, 0.0, _AWAY_M, 0.0)

    def picture(self, x: float, y: float, yaw: float) -> Pixels:
        """Returns the scene with the robot at a pose."""
        seen = self._plain(x, y, 0.0, yaw)
        covered = (seen != self._empty).any(axis=2)
        return np.where(covered[:, :, None], seen, self._ground)

    def _plain(self, x: float, y: float, z: float, yaw: float) -> Pixels:
        self._data.mocap_pos[0] = x, y, z
        self._data.mocap_quat[0] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        mujoco.mj_forward(self._model, self._data)
        kinds = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(self._model, self._data, mujoco.MjvOption(), None, self._camera, kinds, self._scene)
        pixels = np.empty((self._area.height, self._area.width, 3), np.uint8)
        mujoco.mjr_render(self._area, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, self._area, self._context)
        return pixels[::-1]


def _with_robot(scene: FilmScene) -> mujoco.MjSpec:
    """Returns the world cut open, with a robot that stands where it is put: its hull, and a bar that points ahead."""
    spec = world_spec(cut_open(scene.world, CUT_M))
    body = spec.worldbody.add_body(name="filmed-robot", mocap=True)
    half, middle = (scene.high_m - scene.low_m) / 2, (scene.high_m + scene.low_m) / 2
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[scene.radius_m, half, 0.0], pos=[0.0, 0.0, middle], rgba=_HULL
    )
    reach = scene.radius_m / 2
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[reach, 0.1 * scene.radius_m, 0.02],
        pos=[reach, 0.0, scene.high_m + 0.02],
        rgba=_NOSE,
    )
    return spec


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.stdin.buffer, sys.stdout.buffer)
