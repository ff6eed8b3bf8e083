"""Where a name stands on a floor plan: in its room, clear of furniture, turned upright in a narrow room."""

from collections.abc import Sequence
from dataclasses import dataclass

from tasks.export.plan_page import Box, fitted, text_width

NAME_SIZE = 19.0
AREA_SIZE = 14.0
_MIN_NAME_SIZE = 11.0
_LINE = 1.2
_MARGIN = 6.0
_STEPS = 12
_SOFT_WEIGHT = 0.25


@dataclass(frozen=True)
class Label:
    """A name with a second line below it.

    Attributes:
        x: Page x of the middle.
        y: Page y of the middle.
        size: Type size of the name, page units.
        name: The name as it is printed, cut where nothing else helps.
        detail: The second line.
        upright: Whether the text runs upwards.
    """

    x: float
    y: float
    size: float
    name: str
    detail: str
    upright: bool


def place_label(name: str, detail: str, room: Box, obstacles: Sequence[Box], soft: Sequence[Box] = ()) -> Label:
    """Returns the label of a room where it covers least of the obstacles, and of those places nearest the middle.

    Args:
        name: The room's name, any text.
        detail: A short second line.
        room: The room's floor on the page.
        obstacles: Furniture and marks on the page.
        soft: What is better not covered, but rather than furniture.
    """
    inner = room.grown(-_MARGIN)
    upright = inner.height > inner.width and text_width(name, NAME_SIZE) > inner.width
    length = inner.height if upright else inner.width
    size = _size(name, length)
    shown = fitted(name, size, length)
    along = max(text_width(shown, size), text_width(detail, AREA_SIZE))
    across = _LINE * (size + AREA_SIZE)
    width, height = (across, along) if upright else (along, across)
    weights = [*((box, 1.0) for box in obstacles), *((box, _SOFT_WEIGHT) for box in soft)]
    x, y = _freest(inner, width, height, weights)
    return Label(x, y, size, shown, detail, upright)


def _size(name: str, length: float) -> float:
    wanted = text_width(name, NAME_SIZE)
    return NAME_SIZE if wanted <= length else max(_MIN_NAME_SIZE, NAME_SIZE * length / wanted)


def _freest(inner: Box, width: float, height: float, obstacles: Sequence[tuple[Box, float]]) -> tuple[float, float]:
    middle_x, middle_y = inner.center
    slack_x, slack_y = max(0.0, inner.width - width) / 2, max(0.0, inner.height - height) / 2
    best = (float("inf"), 0.0, middle_x, middle_y)
    for row in range(-_STEPS, _STEPS + 1):
        for column in range(-_STEPS, _STEPS + 1):
            x, y = middle_x + slack_x * column / _STEPS, middle_y + slack_y * row / _STEPS
            box = Box(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
            covered = sum(weight * box.overlap(obstacle) for obstacle, weight in obstacles)
            best = min(best, (round(covered, 3), abs(row) + abs(column), x, y))
    return best[2], best[3]
