"""What colour cameras of lanes that a trainer steps see: the pictures that a batch's episodes have, byte for byte.

Each lane is in an episode of its own, at a control step of its own. A picture is due every so many of these, and is
shown some later; before the first it is black, as in ``tasks.simulate.host.color_cameras``. One is drawn when it is
first shown.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import EpisodeRequest, control_stride
from specs.data.world import World
from tasks.render.camera_pool import CameraPool, Shot, standing_cameras
from tasks.simulate.geometry.hull_outline import robot_shape
from tasks.simulate.host.color_cameras import CameraKeys


class ColorTask(NamedTuple):
    """What is drawn.

    Attributes:
        camera: The robot's.
        requests: The pool's episodes.
        worlds: Theirs, by name.
        robot: The ``robot.xml``, which the camera may see.
    """

    camera: ColorCameraDeclaration
    requests: tuple[EpisodeRequest, ...]
    worlds: Mapping[str, World]
    robot: Path


class LaneColors:
    """Pictures that lanes are shown."""

    def __init__(self, task: ColorTask, count: int) -> None:
        """Begins; draws nothing yet.

        Args:
            task: What is drawn.
            count: How many lanes.
        """
        self._task, self._camera = task, task.camera
        self._stride, self._latency = control_stride(task.camera.rate_hz), task.camera.latency_steps
        seen = any(each.sees_robot for each in self._camera.every)
        self._keys = CameraKeys(task.worlds, robot_shape(task.robot) if seen else ())
        # As many as may be on their way, and the one that is shown.
        self._poses = np.zeros((count, self._latency // self._stride + 2, 3), np.float32)
        self._numbers = np.full(count, -1)
        self._pictures = np.zeros((count, *task.camera.shape, 3), np.uint8)
        self._pool: CameraPool | None = None
        self._names: dict[str, tuple[str, ...]] = {}

    def shown(
        self,
        steps: Int[np.ndarray, "lanes"],
        poses: Float32[np.ndarray, "lanes 3"],
        episodes: Int[np.ndarray, "lanes"],
    ) -> UInt8[np.ndarray, "lanes *cameras rows columns 3"]:
        """Returns what lanes are shown, an array of the caller's own.

        Args:
            steps: How many control steps each lane's episode has had; it is asked at each of them.
            poses: Where the robots truly are.
            episodes: Which of the task's episodes each lane is in.

        Raises:
            DrawingFailed: Nothing can be drawn.
        """
        due = np.flatnonzero(steps % self._stride == 0)
        slots = self._poses.shape[1]
        self._poses[due, steps[due] // self._stride % slots] = poses[due]
        numbers = np.where(steps < self._latency, -1, (steps - self._latency) // self._stride)
        changed = np.flatnonzero((numbers != self._numbers) | (steps == 0))
        self._numbers = numbers
        self._pictures[changed[numbers[changed] < 0]] = 0
        seen_from = self._poses[changed, numbers[changed] % slots]
        able = (numbers[changed] >= 0) & np.isfinite(seen_from).all(axis=1)  # one that crashed may be nowhere
        if able.any():
            pool = self._opened()
            pairs = zip(changed[able].tolist(), seen_from[able].tolist(), strict=True)
            shots = [
                shot for lane, pose in pairs for shot in self._shots(int(episodes[lane]), pose, int(numbers[lane]))
            ]
            self._pictures[changed[able]] = pool.color(shots).reshape(-1, *self._pictures.shape[1:])
        return self._pictures.copy()

    def _shots(self, episode: int, pose: list[float], number: int) -> list[Shot]:
        request = self._task.requests[episode]
        x_m, y_m, yaw_rad = pose
        keys = enumerate(self._names[request.world])
        return [Shot(key, x_m, y_m, yaw_rad, request.seed, number, place) for place, key in keys]

    def _opened(self) -> CameraPool:
        if self._pool is None:
            self._pool = standing_cameras(len(self._numbers))
            for world in dict.fromkeys(request.world for request in self._task.requests):
                self._names[world] = self._keys.names(world, self._camera)
                self._keys.add(self._pool, world, self._camera)
        return self._pool
