"""Colour cameras of robots whose controllers run on the host: drawn between two control steps, all lanes together.

A picture is taken every so many control steps, and is shown some steps later, until the next one is there. Before the
first it is black. What is seen follows from the episode alone: its world, the robot's true pose, and its seed.
"""

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.errors import SimyardError
from tasks.render.camera_pool import CameraPool, Shot, open_cameras
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import Observation
from tasks.simulate.host.controllers import HostControllers, HostStart
from tasks.simulate.sensors.depth_camera import picture_stride

_logger = logging.getLogger(__name__)
Pictures = UInt8[np.ndarray, "lanes rows columns 3"]
_SHARED = ("columns", "rows", "rate_hz", "latency_steps")


class _Taken(NamedTuple):
    """Pictures of all lanes, and the control step at which they were taken."""

    step: int
    pictures: Pictures


class SeeingControllers:
    """Controllers on the host, and what their robots' colour cameras show them.

    Attributes:
        cancelled: As of the controllers, of which none asks for its end.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(
        self,
        controllers: HostControllers,
        cameras: Sequence[ColorCameraDeclaration | BundleCrash | None],
        start: HostStart,
    ) -> None:
        """Begins with processes that draw, and ends lanes whose camera cannot be.

        Args:
            controllers: Of plain Python.
            cameras: Each lane's, or why it cannot be.
            start: What the controllers began with.
        """
        self._controllers, self._start = controllers, start
        sound = (each for each in cameras if isinstance(each, ColorCameraDeclaration))
        self._camera = next(sound, ColorCameraDeclaration())
        self._stride = picture_stride(self._camera.rate_hz)
        self._crashes: dict[int, str] = {}
        self._open, self._pool = ExitStack(), None
        self._keys = [self._added_key(lane, camera) for lane, camera in enumerate(cameras)]
        self._step, self._poses = 0, np.zeros((start.width, 3), np.float32)
        blank = np.zeros((start.width, self._camera.rows, self._camera.columns, 3), np.uint8)
        blank.flags.writeable = False
        self._taken = deque([_Taken(-1 - self._camera.latency_steps, blank)])
        self._begin(cameras)

    @property
    def crashes(self) -> Mapping[int, str]:
        """Returns why controllers crashed, or could not be shown anything, by lane."""
        return {**self._crashes, **self._controllers.crashes}

    def see(self, poses: Float32[np.ndarray, "lanes 3"]) -> None:
        """Tells where the robots truly are (x m, y m, yaw rad), before a control step."""
        self._poses = poses

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control, as ``HostControllers.controls``."""
        able = moving.copy()
        able[list(self._crashes)] = False
        try:
            shown = self._shown(able)
        except SimyardError as exc:
            self._crashes.update(dict.fromkeys(np.flatnonzero(able).tolist(), str(exc)))
            return np.full((self._start.width, self._start.actuators), np.nan, np.float32)
        controls = self._controllers.controls(observed._replace(color=shown), able)
        controls[list(self._crashes)] = np.nan
        return controls

    def measures(self, lane: int) -> Mapping[str, int]:
        """Returns what the controllers measure."""
        return self._controllers.measures(lane)

    def close(self) -> None:
        """Ends the controllers, and the processes that draw."""
        self._controllers.close()
        self._open.close()

    def _begin(self, cameras: Sequence[ColorCameraDeclaration | BundleCrash | None]) -> None:
        seeing = sum(map(bool, self._keys))
        if not seeing:
            return
        try:
            self._pool = self._open.enter_context(open_cameras(seeing))
        except SimyardError as exc:
            self._crashes.update(dict.fromkeys(range(len(cameras)), str(exc)))
            return
        _logger.info("colour cameras are drawn by %s", self._pool.gl)
        for lane, camera, key in zip(self._start.lanes, cameras, self._keys, strict=True):
            if key and isinstance(camera, ColorCameraDeclaration):
                self._pool.add(key, self._start.worlds[lane.request.world], camera)

    def _added_key(self, lane: int, camera: ColorCameraDeclaration | BundleCrash | None) -> str:
        """Returns the name of a lane's camera in its world; a lane whose camera cannot be crashes."""
        if isinstance(camera, BundleCrash):
            self._crashes[lane] = camera.reason
        elif camera is None or any(getattr(camera, name) != getattr(self._camera, name) for name in _SHARED):
            self._crashes[lane] = f"color_camera: {', '.join(_SHARED)} must not follow from a numeric variable"
        else:
            return f"{self._start.lanes[lane].request.world} {camera.model_dump_json()}"
        return ""

    def _shown(self, able: Bool[np.ndarray, "lanes"]) -> Pictures:
        """Returns what robots are shown at this control step; counts it."""
        step, self._step = self._step, self._step + 1
        if step % self._stride == 0 and self._pool is not None:
            self._taken.append(_Taken(step, self._drawn(self._pool, able, step // self._stride)))
        while len(self._taken) > 1 and self._taken[1].step + self._camera.latency_steps <= step:
            self._taken.popleft()
        return self._taken[0].pictures

    def _drawn(self, pool: CameraPool, able: Bool[np.ndarray, "lanes"], number: int) -> Pictures:
        """Returns pictures of the lanes that are able; of the others the last ones."""
        lanes = np.flatnonzero(able[: len(self._keys)]).tolist()
        pictures = self._taken[-1].pictures.copy()
        if lanes:
            shots = [self._shot(lane, number) for lane in lanes]
            pictures[lanes] = pool.color(shots)
        pictures.flags.writeable = False
        return pictures

    def _shot(self, lane: int, number: int) -> Shot:
        x_m, y_m, yaw_rad = self._poses[lane].tolist()
        return Shot(self._keys[lane], x_m, y_m, yaw_rad, self._start.lanes[lane].request.seed, number)
