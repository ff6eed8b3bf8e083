"""Worlds in three dimensions, and a robot's drive as a film, where a GL is there.

A process of its own draws: ``render_process``.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Protocol

import numpy as np
from jaxtyping import UInt8
from pydantic import TypeAdapter

from specs.base import Spec
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from tasks.export.drawing.building_plan import floor_m2
from tasks.export.picture.contact_sheet import MOST_WORLDS, wishes_kept
from tasks.render.gl_process import gl_process
from tasks.render.textures import encode_rgb

_PROGRAM = "tasks.export.picture.render_process"
Pixels = UInt8[np.ndarray, "rows columns 3"]
Render = Callable[[World, Sequence[str]], Pixels]
"""Takes a world and the lines of a caption, each of which takes CAPTION_LINE rows of the picture that it returns."""
CHANNELS = 3
REQUEST: TypeAdapter[tuple[tuple[str, ...], World]] = TypeAdapter(tuple[tuple[str, ...], World])
CAPTION_LINE = 26
_SAMPLES = 40


@contextmanager
def open_renderer(width: int, height: int, samples: int = _SAMPLES) -> Generator[Render | None, None, None]:
    """Yields a function that renders a world cut open, or None where no GL is.

    Args:
        width: Columns of a picture.
        height: Rows of a picture.
        samples: Renderings that a picture is the mean of; shadows have about half as many steps.
    """
    with gl_process(_PROGRAM, ["worlds", str(width), str(height), str(samples)]) as process:
        if process is None:
            yield None
            return
        size = (width, height)
        yield lambda world, caption: pixels_of(
            process.ask(world.name, REQUEST.dump_json((tuple(caption), world)), width * height * CHANNELS), *size
        )


def pixels_of(answer: bytes, width: int, height: int) -> Pixels:
    """Returns an answer as a picture."""
    return np.frombuffer(answer, np.uint8).reshape(height, width, CHANNELS)


def render_png(world: World, width: int, height: int) -> bytes | None:
    """Returns a picture of the world, cut open, as a PNG file; None where no GL is."""
    with open_renderer(width, height) as render:
        return None if render is None else encode_rgb(render(world, ()))


class Shoot(Protocol):
    """Takes a picture of the robot at a pose (x m, y m, yaw rad), among people, other robots and boxes (x m, y m)."""

    def __call__(self, x: float, y: float, yaw: float, movers_m: Sequence[Sequence[float]] = ()) -> Pixels:
        """Returns the picture."""
        ...


_FILM_SAMPLES = 24


class FilmScene(Spec):
    """A world and a robot in it.

    Attributes:
        radius_m: Of the hull.
        low_m, high_m: Where it begins and ends above the floor.
        shape: What the robot looks like; without any part its hull is shown as a cylinder.
        people: How many walk there.
        robots: How many other robots of the same hull drive there.
        boxes: How large those are that are put there (m).
    """

    world: World
    radius_m: float
    low_m: float
    high_m: float
    shape: tuple[RobotPart, ...] = ()
    people: int = 0
    robots: int = 0
    boxes: tuple[tuple[float, float, float], ...] = ()


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
    with gl_process(_PROGRAM, ["film", str(width), str(height), str(samples)]) as process:
        if process is None:
            yield None
            return
        process.ask(scene.world.name, scene.model_dump_json().encode(), 1)

        def shoot(x: float, y: float, yaw: float, movers_m: Sequence[Sequence[float]] = ()) -> Pixels:
            asked = " ".join(repr(each) for each in (x, y, yaw, *(axis for mover_m in movers_m for axis in mover_m)))
            return pixels_of(process.ask(scene.world.name, asked.encode(), width * height * CHANNELS), width, height)

        yield shoot


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
