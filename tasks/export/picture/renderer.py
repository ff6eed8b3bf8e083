"""Worlds in three dimensions, and a robot's drive as a film, where a GL is there.

A process of its own draws: ``render_process``.
"""

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import BinaryIO

import numpy as np
from jaxtyping import UInt8
from pydantic import TypeAdapter

from specs.base import Spec
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from specs.errors import SimyardError
from tasks.export.drawing.building_plan import floor_m2
from tasks.export.picture.contact_sheet import MOST_WORLDS, wishes_kept
from tasks.export.surface.textures import encode_rgb

NO_GL = "no 3-D picture: no GL is there (Debian: apt-get install libosmesa6, or libegl1 with a GPU)"
READY = b"GL\n"
"""What the process says when its GL works."""
Pixels = UInt8[np.ndarray, "rows columns 3"]
Render = Callable[[World, Sequence[str]], Pixels]
"""Takes a world and the lines of a caption, each of which takes CAPTION_LINE rows of the picture that it returns."""
Ask = Callable[[str, bytes, int], bytes]
"""Takes what is drawn, for a complaint, a line without its end, and how many bytes the answer has."""
CHANNELS = 3
REQUEST: TypeAdapter[tuple[tuple[str, ...], World]] = TypeAdapter(tuple[tuple[str, ...], World])
CAPTION_LINE = 26
_GL = "MUJOCO_GL"
_BACKENDS = ("egl", "osmesa")
_SAMPLES = 40
# A renderer that hangs is ended. One that works starts in seconds; a large picture on a slow machine takes a minute.
_START_S, _ANSWER_S = 120.0, 1200.0


@contextmanager
def open_renderer(width: int, height: int, samples: int = _SAMPLES) -> Generator[Render | None, None, None]:
    """Yields a function that renders a world cut open, or None where no GL is.

    Args:
        width: Columns of a picture.
        height: Rows of a picture.
        samples: Renderings that a picture is the mean of; shadows have about half as many steps.
    """
    with start_renderer(["worlds", str(width), str(height), str(samples)]) as ask:
        if ask is None:
            yield None
            return
        yield lambda world, caption: pixels_of(
            ask(world.name, REQUEST.dump_json((tuple(caption), world)), width * height * CHANNELS), width, height
        )


@contextmanager
def start_renderer(arguments: Sequence[str]) -> Generator[Ask | None, None, None]:
    """Yields a function that asks a process of its own, which draws with a GL; None where no GL is.

    Args:
        arguments: Its command line.
    """
    with tempfile.TemporaryFile() as complaints:
        process = _start_process(arguments, complaints)
        if process is None:
            yield None
            return
        try:
            yield lambda what, question, length: _answer(process, what, question, length, complaints)
        finally:
            process.kill()
            process.communicate()


def pixels_of(answer: bytes, width: int, height: int) -> Pixels:
    """Returns an answer as a picture."""
    return np.frombuffer(answer, np.uint8).reshape(height, width, CHANNELS)


def render_png(world: World, width: int, height: int) -> bytes | None:
    """Returns a picture of the world, cut open, as a PNG file; None where no GL is."""
    with open_renderer(width, height) as render:
        return None if render is None else encode_rgb(render(world, ()))


def _start_process(arguments: Sequence[str], complaints: BinaryIO) -> subprocess.Popen[bytes] | None:
    """Returns the process, ready to draw with the first GL that works: MUJOCO_GL's, else any.

    Raises:
        SimyardError: It says nothing and does not end.
    """
    wanted = os.environ.get(_GL)
    for backend in (wanted,) if wanted else _BACKENDS:
        process = subprocess.Popen(  # noqa: S603 - our own module, and numbers
            [sys.executable, "-m", "tasks.export.picture.render_process", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            env={**os.environ, _GL: backend},
        )
        try:
            ready = _ask(process, b"", len(READY), _START_S) == READY
        except TimeoutError as exc:
            process.communicate()
            raise SimyardError(f"the renderer hangs at its start with {_GL}={backend}: {exc}; set another") from exc
        if ready:
            return process
        process.communicate()
    return None


def _answer(process: subprocess.Popen[bytes], what: str, question: bytes, length: int, complaints: BinaryIO) -> bytes:
    """Returns the answer of the process to a line.

    Raises:
        RuntimeError: It ended, which a GL that works is no reason for.
        SimyardError: It does not answer.
    """
    try:
        answer = _ask(process, question + b"\n", length, _ANSWER_S)
    except TimeoutError as exc:
        raise SimyardError(f"rendering {what} failed: {exc}") from exc
    if len(answer) < length:
        complaints.seek(0)
        raise RuntimeError(f"rendering {what} failed: {complaints.read().decode(errors='replace')[-2000:]}")
    return answer


def _ask(process: subprocess.Popen[bytes], question: bytes, length: int, limit_s: float) -> bytes:
    """Returns the answer, shorter than ``length`` when the process has ended.

    Raises:
        TimeoutError: It took longer than the limit, and was ended.
    """
    if process.stdin is None or process.stdout is None:
        return b""
    expired = threading.Event()

    def end() -> None:
        expired.set()
        process.kill()

    watchdog = threading.Timer(limit_s, end)
    watchdog.start()
    try:
        process.stdin.write(question)
        process.stdin.flush()
        answer = process.stdout.read(length)
    except BrokenPipeError:
        answer = b""
    finally:
        watchdog.cancel()
    if len(answer) < length and expired.is_set():
        raise TimeoutError(f"no answer within {limit_s:g} s")
    return answer


Shoot = Callable[[float, float, float], Pixels]
"""Takes the robot's pose (x m, y m, yaw rad)."""


_FILM_SAMPLES = 24


class FilmScene(Spec):
    """A world and a robot in it.

    Attributes:
        radius_m: Of the hull.
        low_m, high_m: Where it begins and ends above the floor.
        shape: What the robot looks like; without any part its hull is shown as a cylinder.
    """

    world: World
    radius_m: float
    low_m: float
    high_m: float
    shape: tuple[RobotPart, ...] = ()


@contextmanager
def open_film(
    scene: FilmScene, width: int, height: int, samples: int = _FILM_SAMPLES
) -> Generator[Shoot | None, None, None]:
    """Yields a function that takes a picture of the robot at a pose, or None where no GL is.

    Args:
        scene: What is seen.
        width: Columns of a picture.
        height: Rows of a picture.
        samples: Renderings that what stands still is the mean of.
    """
    with start_renderer(["film", str(width), str(height), str(samples)]) as ask:
        if ask is None:
            yield None
            return
        ask(scene.world.name, scene.model_dump_json().encode(), 1)
        yield lambda x, y, yaw: pixels_of(
            ask(scene.world.name, f"{x!r} {y!r} {yaw!r}".encode(), width * height * CHANNELS), width, height
        )


_CELL_WIDTH, _CELL_HEIGHT = 440, 330 + 3 * CAPTION_LINE
_SHEET_SAMPLES = 16  # small pictures need fewer: their shadows are a few pixels wide
_MARGIN = 24


def render_sheet_png(worlds: Iterable[World], most: int = MOST_WORLDS) -> bytes | None:
    """Returns the first worlds, rendered and captioned, in a grid; None where no GL is.

    Args:
        worlds: At least one.
        most: How many of them are kept, and rendered.

    Raises:
        ValueError: There are no worlds.
    """
    shown = list(islice(worlds, most))
    if not shown:
        raise ValueError("a contact sheet needs a world")
    columns = min(len(shown), max(3, round((1.2 * len(shown)) ** 0.5)))
    rows = -(-len(shown) // columns)
    size = (rows * _CELL_HEIGHT + 2 * _MARGIN, columns * _CELL_WIDTH + 2 * _MARGIN, 3)
    sheet = np.full(size, 255, np.uint8)
    with open_renderer(_CELL_WIDTH, _CELL_HEIGHT, _SHEET_SAMPLES) as render:
        if render is None:
            return None
        for number, world in enumerate(shown):
            row, column = divmod(number, columns)
            top, left = _MARGIN + row * _CELL_HEIGHT, _MARGIN + column * _CELL_WIDTH
            sheet[top : top + _CELL_HEIGHT, left : left + _CELL_WIDTH] = render(world, _caption(world))
    return encode_rgb(sheet)


def _caption(world: World) -> tuple[str, ...]:
    certificate = world.certificate
    return (
        world.name,
        f"{floor_m2(world):.1f} m2, {100 * certificate.free_floor_share:.0f} % free, "
        f"robot up to {certificate.reachable_robot_radius_m:.2f} m",
        wishes_kept(certificate),
    )
