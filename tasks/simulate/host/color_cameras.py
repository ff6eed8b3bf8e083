"""Colour cameras of robots whose controllers run on the host: drawn between two control steps, all lanes together.

A picture is taken every so many control steps, and is shown some steps later, until the next one is there. Before the
first it is black. What is seen follows from the episode alone: its world, the robot's true pose, and its seed.
"""

import hashlib
import logging
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import control_stride
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.render.camera_pool import CameraPool, Shot, standing_cameras
from tasks.render.gl_process import DrawingFailed
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import Observation
from tasks.simulate.geometry.hull_outline import robot_shape
from tasks.simulate.host.controllers import HostControllers, HostStart

_logger = logging.getLogger(__name__)
Pictures = UInt8[np.ndarray, "lanes *cameras rows columns 3"]
_SHARED = ("shape", "rate_hz", "latency_steps")


class _Taken(NamedTuple):
    """Pictures of all lanes.

    Attributes:
        step: The control step at which they were taken.
        number: Of the pictures; the first are 0.
        poses: Where the robots were.
        able: Lanes of which there are pictures.
    """

    step: int
    number: int
    poses: Float32[np.ndarray, "lanes 3"]
    able: Bool[np.ndarray, "lanes"]


class CameraKeys:
    """Names of cameras in worlds, for processes that stay: others may have their worlds' names later."""

    def __init__(self, worlds: Mapping[str, World], robot: tuple[RobotPart, ...]) -> None:
        """Begins.

        Args:
            worlds: By name.
            robot: What cameras may see of their own robots.
        """
        self._worlds, self._robot, self._digests = worlds, robot, dict[str, str]()

    def name(self, world: str, camera: ColorCameraDeclaration) -> str:
        """Returns the name of a camera in a world, whichever others are in a list with it."""
        if world not in self._digests:
            text = f"{self._robot}{self._worlds[world].model_dump_json()}"
            self._digests[world] = hashlib.sha256(text.encode()).hexdigest()
        return f"{self._digests[world]} {camera.model_dump_json(exclude={'others'})}"

    def add(self, pool: CameraPool, world: str, camera: ColorCameraDeclaration) -> None:
        """Adds a camera in a world to a pool."""
        for each in camera.every:
            robot = self._robot if each.sees_robot else ()
            pool.add(self.name(world, each), self._worlds[world], each.model_copy(update={"others": ()}), robot)

    def names(self, world: str, camera: ColorCameraDeclaration) -> tuple[str, ...]:
        """Returns the names of a camera, and of those behind it in a list, in a world."""
        return tuple(self.name(world, each) for each in camera.every)


class LanePictures:
    """What the colour cameras of a chunk's robots see, for whoever drives them. Nothing is drawn that nobody asks for.

    Attributes:
        crashes: Why lanes can be shown nothing, by lane.
        undrawn: Lanes that moved when nothing could be drawn, which is no application's fault.
        gl: Which GL drew; empty if nothing was drawn.
    """

    def __init__(
        self, cameras: Sequence[ColorCameraDeclaration | BundleCrash | None], start: HostStart, robot: Path
    ) -> None:
        """Begins, and ends lanes whose camera cannot be.

        Args:
            cameras: Each lane's, or why it cannot be.
            start: What the controllers begin with.
            robot: The ``robot.xml``, which cameras may see.
        """
        self._start, self._cameras = start, cameras
        sound = (each for each in cameras if isinstance(each, ColorCameraDeclaration))
        self._camera = next(sound, ColorCameraDeclaration())
        self._stride = control_stride(self._camera.rate_hz)
        self.crashes: dict[int, str] = {}
        self.undrawn, self.gl = set[int](), ""
        self._pool: CameraPool | None = None
        self._moving = np.zeros(start.width, np.bool_)
        seen = any(one.sees_robot for each in cameras if isinstance(each, ColorCameraDeclaration) for one in each.every)
        self._names = CameraKeys(start.worlds, robot_shape(robot) if seen else ())
        self._keys = [self._added_keys(lane, camera) for lane, camera in enumerate(cameras)]
        self._step, self._poses = 0, np.zeros((start.width, 3), np.float32)
        self._blank = np.zeros((start.width, *self._camera.shape, 3), np.uint8)
        self._blank.flags.writeable = False
        self._taken = deque([_Taken(-1 - self._camera.latency_steps, -1, self._poses, np.zeros(start.width, np.bool_))])
        self._drawn = {-1: self._blank}

    def see(self, poses: Float32[np.ndarray, "lanes 3"]) -> None:
        """Tells where the robots truly are (x m, y m, yaw rad), before a control step."""
        self._poses = poses

    def take(self, moving: Bool[np.ndarray, "lanes"]) -> None:
        """Counts a control step, and notes what cameras see in it if a picture is due."""
        step, self._step, self._moving = self._step, self._step + 1, self.able(moving)
        if step % self._stride == 0:
            poses = self._poses.copy()  # they are drawn later, if somebody asks
            self._taken.append(_Taken(step, step // self._stride, poses, self._moving))
        while len(self._taken) > 1 and self._taken[1].step + self._camera.latency_steps <= step:
            self._drawn.pop(self._taken.popleft().number, None)

    def shown(self) -> Pictures:
        """Returns what robots are shown at this control step.

        Raises:
            DrawingFailed: Nothing can be drawn.
        """
        return self._pictures(self._taken[0])

    def shown_at_once(self, moving: Bool[np.ndarray, "lanes"]) -> Pictures:
        """Returns what robots are shown at a control step, and counts it; lanes for which nothing is drawn crash."""
        self.take(moving)
        try:
            self._pictures(self._taken[-1])
            return self.shown()
        except DrawingFailed as exc:
            self.crashes.update(dict.fromkeys(self.undrawn, " ".join(str(exc).split())))
            return self._blank

    def able(self, moving: Bool[np.ndarray, "lanes"]) -> Bool[np.ndarray, "lanes"]:
        """Returns which of some lanes can be shown pictures."""
        able = moving.copy()
        able[list(self.crashes)] = False
        return able

    def first_camera(self) -> ColorCameraDeclaration | None:
        """Returns the first lane's camera; None if nothing was drawn for it, or it could not be drawn to the end."""
        first, drawn = self._cameras[0], self.gl and self._keys[0] and not self.undrawn
        return first if drawn and isinstance(first, ColorCameraDeclaration) else None

    def drawn_again(
        self, steps: Int[np.ndarray, "pictures"], poses: Float32[np.ndarray, "pictures 3"]
    ) -> UInt8[np.ndarray, "pictures rows columns 3"]:
        """Returns what the first lane's camera saw, as ``SeesWorlds.drawn_again``."""
        keys, seed = self._keys[0], self._start.lanes[0].request.seed
        shots = [
            Shot(key, x_m, y_m, yaw_rad, seed, step // self._stride, place)
            for step, (x_m, y_m, yaw_rad) in zip(steps.tolist(), poses.tolist(), strict=True)
            for place, key in enumerate(keys)
        ]
        return self._opened().color(shots).reshape(len(steps), -1, self._camera.columns, 3)

    def failure_code(self, lane: int) -> SimulationJobErrorCode:
        """Returns whose fault it is that a lane, which crashed, did not come to its end."""
        return "InternalServiceError" if lane in self.undrawn else "RobotApplicationCrash"

    def _pictures(self, taken: _Taken) -> Pictures:
        if taken.number not in self._drawn:
            pictures, lanes = self._blank.copy(), np.flatnonzero(taken.able[: len(self._keys)]).tolist()
            if lanes:
                drawn = self._shots_drawn([shot for lane in lanes for shot in self._shots(lane, taken)])
                pictures[lanes] = drawn.reshape(len(lanes), *pictures.shape[1:])
            pictures.flags.writeable = False
            self._drawn[taken.number] = pictures
        return self._drawn[taken.number]

    def _shots_drawn(self, shots: Sequence[Shot]) -> UInt8[np.ndarray, "shots rows columns 3"]:
        try:
            return self._opened().color(shots)
        except DrawingFailed:
            self.undrawn.update(np.flatnonzero(self._moving).tolist())
            raise

    def _opened(self) -> CameraPool:
        if self._pool is None:
            self._pool = standing_cameras(sum(map(bool, self._keys)))
            self.gl = self._pool.gl
            _logger.info("colour cameras are drawn by %s", self.gl)
            for lane, camera, key in zip(self._start.lanes, self._cameras, self._keys, strict=True):
                if isinstance(camera, ColorCameraDeclaration) and key:
                    self._names.add(self._pool, lane.request.world, camera)
        return self._pool

    def _added_keys(self, lane: int, camera: ColorCameraDeclaration | BundleCrash | None) -> tuple[str, ...]:
        """Returns the names of a lane's cameras in its world; a lane whose camera cannot be crashes."""
        if isinstance(camera, BundleCrash):
            self.crashes[lane] = camera.reason
        elif camera is None or any(getattr(camera, name) != getattr(self._camera, name) for name in _SHARED):
            names = "columns, rows, rate_hz, latency_steps and how many there are"
            self.crashes[lane] = f"color_camera: {names} must not follow from a numeric variable"
        else:
            return self._names.names(self._start.lanes[lane].request.world, camera)
        return ()

    def _shots(self, lane: int, taken: _Taken) -> list[Shot]:
        (x_m, y_m, yaw_rad), seed = taken.poses[lane].tolist(), self._start.lanes[lane].request.seed
        keys = enumerate(self._keys[lane])
        return [Shot(key, x_m, y_m, yaw_rad, seed, taken.number, place) for place, key in keys]


class SeeingControllers:
    """Controllers on the host, and what their robots' colour cameras show them.

    Attributes:
        cancelled: As of the controllers, of which none asks for its end.
    """

    cancelled: frozenset[int] = frozenset()

    def __init__(self, controllers: HostControllers, pictures: LanePictures, start: HostStart) -> None:
        """Begins.

        Args:
            controllers: Of plain Python.
            pictures: What they are shown.
            start: What they began with.
        """
        self._controllers, self._pictures = controllers, pictures
        self._shape = (start.width, start.actuators)
        self.see, self.first_camera, self.drawn_again = pictures.see, pictures.first_camera, pictures.drawn_again
        self.failure_code = pictures.failure_code

    @property
    def gl(self) -> str:
        """Returns which GL drew; empty if nothing was drawn."""
        return self._pictures.gl

    @property
    def crashes(self) -> Mapping[int, str]:
        """Returns why controllers crashed, or could not be shown anything, by lane."""
        return {**self._pictures.crashes, **self._controllers.crashes}

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control, as ``HostControllers.controls``."""
        shown = self._pictures.shown_at_once(moving)
        able = self._pictures.able(moving)
        if moving.any() and not able.any():
            return np.full(self._shape, np.nan, np.float32)
        controls = self._controllers.controls(observed._replace(color=shown), able)
        controls[list(self._pictures.crashes)] = np.nan
        return controls

    def measures(self, lane: int) -> Mapping[str, int]:
        """Returns what the controllers measure."""
        return self._controllers.measures(lane)

    def close(self) -> None:
        """Ends the controllers."""
        self._controllers.close()
