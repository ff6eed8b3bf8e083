"""Processes that draw what cameras on robots see, a core each: cameras of many episodes at once, in turns.

A picture follows from the world, the camera, the pose, the seed and its number alone, and from the GL. So it is the
same whoever draws it, after whatever, and a process that was killed is started again and asked once more.
"""

import atexit
import functools
import logging
import os
import sys
from collections import OrderedDict
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, UInt8
from pydantic import Field, TypeAdapter

from specs.base import Spec
from specs.bundle_files import ColorCameraDeclaration
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from tasks.render.gl_process import ANOTHER_GL, NO_GL, DrawingEndedError, DrawingFailed, GlProcess, start_gl_process

_PROGRAM = "tasks.render.camera_process"
# A picture is small: a GL that shared it out among threads of its own would wait for them longer than it draws.
_ENVIRONMENT = {"LP_NUM_THREADS": "0"}
_WORLDS_KEPT = 128  # of 8 MB; one that is not kept takes as long to make as sixty pictures of it
_CHANNELS, _DEPTH_BYTES = 3, 8
DRAWN = b"!"
_logger = logging.getLogger(__name__)


class Shot(NamedTuple):
    """A picture to take.

    Attributes:
        key: The camera's.
        x_m, y_m, yaw_rad: Where its robot is.
        seed: The episode's.
        number: The picture's in its episode, from 0.
        place: The camera's in a list of several on a robot.
    """

    key: str
    x_m: float
    y_m: float
    yaw_rad: float
    seed: int = 0
    number: int = 0
    place: int = 0


class AddCamera(Spec):
    """A camera in a world, which shots name by a key; and what it sees of its own robot."""

    kind: Literal["camera"] = "camera"
    key: str
    world: World
    camera: ColorCameraDeclaration
    robot: tuple[RobotPart, ...] = ()


class Draw(Spec):
    """Pictures in colour; or depths as float32, then solids as int32, each picture's after the other."""

    kind: Literal["color", "depth"]
    shots: tuple[Shot, ...]


class Forget(Spec):
    """A camera that no shot will name before it is added again."""

    kind: Literal["forget"] = "forget"
    key: str


REQUEST: TypeAdapter[AddCamera | Draw | Forget] = TypeAdapter(
    Annotated[AddCamera | Draw | Forget, Field(discriminator="kind")]
)


@contextmanager
def open_cameras(most: int) -> Generator["CameraPool", None, None]:
    """Yields processes that draw; they end with the block, or with this process.

    Args:
        most: How many at most; there is one for each core that this process may use.

    Raises:
        DrawingFailed: There is no GL.
    """
    drawers = _started_drawers(_count(most))
    with ThreadPoolExecutor(len(drawers)) as executor:
        try:
            yield CameraPool(drawers, executor)
        finally:
            for each in drawers:
                each.process.close()


def standing_cameras(most: int) -> "CameraPool":
    """Returns processes that draw, as ``open_cameras``, which stay for whoever asks next, and end with this process.

    They keep worlds by their cameras' keys: whoever asks names the same camera in the same world by the same key.
    """
    stand, count = _standing(os.environ.get("MUJOCO_GL", "")), _count(most)
    stand.drawers.extend(_started_drawers(count - len(stand.drawers)))
    return CameraPool(stand.drawers[:count], stand.executor)


class _Standing(NamedTuple):
    """Processes that stay."""

    drawers: list["_Drawer"]
    executor: ThreadPoolExecutor


@functools.cache
def _standing(gl: str) -> _Standing:  # noqa: ARG001 - which is asked for: another one draws in processes of its own
    drawers: list[_Drawer] = []

    @atexit.register
    def end() -> None:
        for each in drawers:
            each.process.close()

    return _Standing(drawers, ThreadPoolExecutor(_count(sys.maxsize), "simyard cameras"))


def _count(most: int) -> int:
    return min(most, len(os.sched_getaffinity(0)))


def _started_drawers(count: int) -> list["_Drawer"]:
    """Returns so many processes that draw; none of them stays where one does not start."""
    if count <= 0:
        return []
    with ThreadPoolExecutor(count) as executor:
        started = [executor.submit(_Drawer) for _ in range(count)]
    try:
        return [each.result() for each in started]
    except BaseException:
        for each in started:
            if each.exception() is None:
                each.result().process.close()
        raise


class CameraPool:
    """Cameras that were added, and processes that draw what they see.

    Attributes:
        gl: Which GL draws, for a person.
    """

    def __init__(self, drawers: Sequence["_Drawer"], executor: ThreadPoolExecutor) -> None:
        self.gl = drawers[0].process.gl
        self._drawers, self._executor = drawers, executor
        self._cameras: dict[str, AddCamera] = {}

    @property
    def pids(self) -> tuple[int, ...]:
        """Returns the processes' numbers."""
        return tuple(each.process.pid for each in self._drawers)

    def add(self, key: str, world: World, camera: ColorCameraDeclaration, robot: tuple[RobotPart, ...] = ()) -> None:
        """Adds a camera in a world, and what it sees of its own robot; the same key again names the same."""
        self._cameras.setdefault(key, AddCamera(key=key, world=world, camera=camera, robot=robot))

    def color(self, shots: Sequence[Shot]) -> UInt8[np.ndarray, "shots rows columns 3"]:
        """Returns pictures, in the order of the shots, whose cameras have pictures of one size.

        Raises:
            DrawingFailed: A process ended twice over the same pictures, or hangs.
        """
        camera = self._cameras[shots[0].key].camera
        size = (camera.rows, camera.columns, _CHANNELS)
        return np.frombuffer(self._drawn("color", shots, int(np.prod(size))), np.uint8).reshape(-1, *size)

    def depth_and_solids(
        self, shots: Sequence[Shot]
    ) -> tuple[Float32[np.ndarray, "shots rows columns"], Int32[np.ndarray, "shots rows columns"]]:
        """Returns depths (m) and numbers of solids, as ``CameraRenderer.depth_and_solids``.

        Raises:
            DrawingFailed: A process ended twice over the same pictures, or hangs.
        """
        camera = self._cameras[shots[0].key].camera
        size = (camera.rows, camera.columns)
        drawn = self._drawn("depth", shots, _DEPTH_BYTES * camera.rows * camera.columns)
        both = np.frombuffer(drawn, np.int32).reshape(-1, 2, *size)
        return both[:, 0].view(np.float32), both[:, 1]

    def _drawn(self, kind: Literal["color", "depth"], shots: Sequence[Shot], length: int) -> bytes:
        """Returns all pictures, one after the other; who has drawn a world before draws it again."""
        shares = self._shares(shots)
        asked = [Draw(kind=kind, shots=tuple(shots[place] for place in share)) for share in shares]
        futures = [
            self._executor.submit(drawer.draw, request, self._cameras, length)
            for drawer, request in zip(self._drawers, asked, strict=True)
        ]
        wait(futures)  # also where one fails: a process is asked one thing at a time, and ends with the block
        pictures = [b""] * len(shots)
        for share, future in zip(shares, futures, strict=True):
            answer = future.result()
            for number, place in enumerate(share):
                pictures[place] = answer[number * length : (number + 1) * length]
        return b"".join(pictures)

    def _shares(self, shots: Sequence[Shot]) -> list[list[int]]:
        """Returns the places of each process's shots: all of a camera's, or of few cameras' as many as the others."""
        count = len(self._drawers)
        owners = {key: number % count for number, key in enumerate(self._cameras)}
        shares: list[list[int]] = [[] for _ in self._drawers]
        for place, shot in enumerate(shots):
            shares[owners[shot.key] if len(owners) >= count else place % count].append(place)
        return shares


class _Drawer:
    """A process, and which cameras it has."""

    def __init__(self) -> None:
        self.process = _started()
        self._has = OrderedDict[str, None]()

    def draw(self, request: Draw, cameras: Mapping[str, AddCamera], length: int) -> bytes:
        """Returns the pictures of a request, each ``length`` bytes long."""
        try:
            return self._asked(request, cameras, length)
        except DrawingEndedError as exc:
            _logger.warning("process %d: %s: started again", self.process.pid, exc)
        fresh = _started()  # where none starts, whoever asks next finds one that has ended, and tries again
        self.process.close()
        self.process = fresh
        self._has.clear()
        try:
            return self._asked(request, cameras, length)
        except DrawingEndedError as exc:
            why = f"twice, at the same pictures, with {self.process.gl}; {ANOTHER_GL}"
            raise DrawingFailed(f"{exc}: {why}") from exc

    def _asked(self, request: Draw, cameras: Mapping[str, AddCamera], length: int) -> bytes:
        answers: list[bytes] = []
        for start in range(0, len(request.shots), _WORLDS_KEPT):  # of which all worlds fit
            some = request.shots[start : start + _WORLDS_KEPT]
            for key in dict.fromkeys(shot.key for shot in some):
                self._teach(cameras[key])
            wanted = request.model_copy(update={"shots": some})
            answers.append(self._ask(wanted, length * len(some)))
        return b"".join(answers)

    def _teach(self, camera: AddCamera) -> None:
        if camera.key not in self._has:
            self._ask(camera, len(DRAWN))
        self._has[camera.key] = None
        self._has.move_to_end(camera.key)
        if len(self._has) > _WORLDS_KEPT:
            self._ask(Forget(key=self._has.popitem(last=False)[0]), len(DRAWN))

    def _ask(self, request: AddCamera | Draw | Forget, length: int) -> bytes:
        return self.process.ask("a camera's picture", request.model_dump_json().encode(), length)


def _started() -> GlProcess:
    # A process that simulates draws nothing itself, and is told so by this variable.
    anyone = {"MUJOCO_GL": ""} if os.environ.get("MUJOCO_GL") == "disable" else {}
    process = start_gl_process(_PROGRAM, environment=_ENVIRONMENT | anyone)
    if process is None:
        raise DrawingFailed(NO_GL.replace("3-D picture", "camera's picture"))
    return process
