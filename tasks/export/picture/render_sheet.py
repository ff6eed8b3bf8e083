"""The worlds of a job in three dimensions on one sheet, as one PNG file."""

from collections.abc import Iterable
from itertools import islice

import numpy as np

from specs.data.world import World
from tasks.export.drawing.floor_patterns import area_m2
from tasks.export.picture.contact_sheet import MOST_WORLDS, wishes_kept
from tasks.export.picture.render import CAPTION_LINE, open_renderer
from tasks.export.surface.png import encode_rgb

_CELL_WIDTH, _CELL_HEIGHT = 440, 330 + 3 * CAPTION_LINE
_SAMPLES = 16  # small pictures need fewer: their shadows are a few pixels wide
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
    with open_renderer(_CELL_WIDTH, _CELL_HEIGHT, _SAMPLES) as render:
        if render is None:
            return None
        for number, world in enumerate(shown):
            row, column = divmod(number, columns)
            top, left = _MARGIN + row * _CELL_HEIGHT, _MARGIN + column * _CELL_WIDTH
            sheet[top : top + _CELL_HEIGHT, left : left + _CELL_WIDTH] = render(world, _caption(world))
    return encode_rgb(sheet)


def _caption(world: World) -> tuple[str, ...]:
    certificate = world.certificate
    total_m2 = sum(area_m2(room.floor) for room in world.rooms)
    return (
        world.name,
        f"{total_m2:.1f} m2, {100 * certificate.free_floor_share:.0f} % free, "
        f"robot up to {certificate.reachable_robot_radius_m:.2f} m",
        wishes_kept(certificate),
    )
