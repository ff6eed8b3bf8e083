"""A robot driving through a world in three dimensions, where a GL is there; the drawing is done by ``film_process``."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

from specs.base import Spec
from specs.data.world import World
from tasks.export.picture.render import CHANNELS, Pixels, pixels_of, start_renderer

Shoot = Callable[[float, float, float], Pixels]
"""Takes the robot's pose (x m, y m, yaw rad)."""


_SAMPLES = 24


class FilmScene(Spec):
    """A world and the hull of a robot in it.

    Attributes:
        radius_m: Of the hull.
        low_m, high_m: Where it begins and ends above the floor.
    """

    world: World
    radius_m: float
    low_m: float
    high_m: float


@contextmanager
def open_film(
    scene: FilmScene, width: int, height: int, samples: int = _SAMPLES
) -> Generator[Shoot | None, None, None]:
    """Yields a function that takes a picture of the robot at a pose, or None where no GL is.

    Args:
        scene: What is seen.
        width: Columns of a picture.
        height: Rows of a picture.
        samples: Renderings that what stands still is the mean of.
    """
    with start_renderer("film_process", [str(width), str(height), str(samples)]) as ask:
        if ask is None:
            yield None
            return
        ask(scene.world.name, scene.model_dump_json().encode(), 1)
        yield lambda x, y, yaw: pixels_of(
            ask(scene.world.name, f"{x!r} {y!r} {yaw!r}".encode(), width * height * CHANNELS), width, height
        )
