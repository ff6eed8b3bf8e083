"""Where a name stands on a floor plan: in its room, clear of furniture, turned upright in a narrow room."""

from collections.abc import Sequence
from dataclasses import dataclass

from tasks.export.drawing.plan_page import PageBox, fit_text, text_width

NAME_SIZE = 18.0
DETAIL_SIZE = 12.5
_MIN_NAME_SIZE, _MIN_DETAIL_SIZE = 10.0, 8.0
_LINE = 1.25
_BOLD = 1.1  # of names, against text_width's upright face
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
        detail: The second line; empty where there is no room for one.
        detail_size: Its type size.
        upright: Whether the text runs upwards.
    """

    x: float
    y: float
    size: float
    name: str
    detail: str
    detail_size: float
    upright: bool

    @property
    def box(self) -> PageBox:
        """Returns the page box of the text."""
        along, across = _extent(self)
        half_x, half_y = (across / 2, along / 2) if self.upright else (along / 2, across / 2)
        return PageBox(self.x - half_x, self.y - half_y, self.x + half_x, self.y + half_y)


def place_label(
    name: str, details: Sequence[str], room: PageBox, obstacles: Sequence[PageBox], soft: Sequence[PageBox] = ()
) -> Label:
    """Returns the label of a room where it covers least of the obstacles, and of those places nearest the middle.

    Args:
        name: The room's name, any text.
        details: A second line in words, and shorter ones for rooms where it does not fit.
        room: The room's floor on the page.
        obstacles: Furniture and marks on the page.
        soft: What is better not covered, but rather than furniture.
    """
    inner = room.grown(-_MARGIN)
    upright = inner.height > inner.width and text_width(name, _BOLD * NAME_SIZE) > inner.width
    length, depth = (inner.height, inner.width) if upright else (inner.width, inner.height)
    size = _size(text_width(name, _BOLD * NAME_SIZE), length, NAME_SIZE, _MIN_NAME_SIZE)
    detail = next((text for text in details if text_width(text, DETAIL_SIZE) <= length), details[-1])
    detail_size = _size(text_width(detail, DETAIL_SIZE), length, DETAIL_SIZE, _MIN_DETAIL_SIZE)
    if text_width(detail, detail_size) > length or _LINE * (size + detail_size) > depth:
        detail = ""
    label = Label(0.0, 0.0, size, fit_text(name, _BOLD * size, length), detail, detail_size, upright)
    weights = [*((box, 1.0) for box in obstacles), *((box, _SOFT_WEIGHT) for box in soft)]
    x, y = _freest(inner, label.box, weights)
    return Label(x, y, size, label.name, detail, detail_size, upright)


def _extent(label: Label) -> tuple[float, float]:
    """Returns how long and how high a label is, before it is turned."""
    along = max(text_width(label.name, _BOLD * label.size), text_width(label.detail, label.detail_size))
    return along, _LINE * (label.size + (label.detail_size if label.detail else 0.0))


def _size(wanted: float, length: float, size: float, smallest: float) -> float:
    return size if wanted <= length else max(smallest, size * length / wanted)


def _freest(inner: PageBox, label: PageBox, obstacles: Sequence[tuple[PageBox, float]]) -> tuple[float, float]:
    """Returns the middle of the place, of a grid over the room, that covers least."""
    middle_x, middle_y = inner.center
    steps = range(-_STEPS, _STEPS + 1)
    x = [middle_x + max(0.0, inner.width - label.width) / 2 * step / _STEPS for step in steps]
    y = [middle_y + max(0.0, inner.height - label.height) / 2 * step / _STEPS for step in steps]
    covered = [[0.0] * len(steps) for _ in steps]
    for box, weight in obstacles:
        beside = [max(0.0, min(at + label.width / 2, box.right) - max(at - label.width / 2, box.left)) for at in x]
        above = [max(0.0, min(at + label.height / 2, box.bottom) - max(at - label.height / 2, box.top)) for at in y]
        for row, high in enumerate(above):
            if high:
                shares = zip(covered[row], beside, strict=True)
                covered[row] = [before + weight * high * wide for before, wide in shares]
    # Rounded, so that the last bit of a sum decides nothing; then the nearest, then the first.
    _, _, row, column = min(
        (round(1000 * covered[row][column]), abs(down) + abs(right), row, column)
        for row, down in enumerate(steps)
        for column, right in enumerate(steps)
    )
    return x[column], y[row]
