"""What cabinets, shelves and media units are made of."""

from tasks.worlds.furniture.primitives import (
    BASKET,
    BOTTLE,
    CUSHION,
    DARK,
    FRONT,
    SCREEN,
    SPIRIT,
    STEEL,
    WHITE,
    WOOD,
    Paint,
    Part,
    Range,
    Size,
    Style,
    block,
    fronts,
    post,
    shaded,
    stand,
)

_STAND_M = 0.1
_BOARD_M = 0.03
_BOOKS = (Paint("", (0.48, 0.2, 0.17)), Paint("", (0.2, 0.3, 0.42)), Paint("", (0.82, 0.72, 0.5)))
_BOXES = (BASKET, shaded(STEEL, 0.85))
_SHELF_DEPTH_M = (0.4, 0.55)


def chest(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a chest of drawers, two columns when it is wide."""
    width, _, height = size
    rows = 4 if height > 0.95 else 3
    drawers = fronts(2 if width > 1.0 else 1, rows, *_face(size), name="drawer")
    return (*_body(size, style, top=True), *drawers)


def nightstand(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a small cabinet with two drawers and a book on it."""
    y, height = size[1] / 2, size[2] - 0.04
    low = (size[0], size[1], height)
    return (
        *_body(low, style),
        *fronts(1, 2, *_face(low), name="drawer"),
        block("book", (-0.12, 0.1), (-y + 0.1, y - 0.1), (height, size[2]), CUSHION),
    )


def sideboard(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a long low cabinet with three or four doors and a bowl on top."""
    width, depth, height = size
    low = (width, depth, height - 0.1)
    return (
        *_body(low, style, top=True),
        *fronts(4 if width > 1.5 else 3, 1, *_face(low), name="door"),
        post("bowl", (0.2 * width, 0.0), 0.14, (height - 0.1, height), CUSHION),
    )


def bar_cabinet(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a high cabinet with two doors, and bottles on its top."""
    width, depth, height = size
    low = (width, depth, height - 0.28)
    bottles = (((-0.3, 0.0), 0.28, BOTTLE), ((-0.18, 0.05), 0.24, SPIRIT), ((0.2, 0.0), 0.14, STEEL))
    return (
        *_body(low, style, top=True),
        *fronts(2, 1, *_face(low), name="door"),
        *(
            post(f"bottle_{n}", at, 0.04 if tall > 0.2 else 0.09, (low[2], low[2] + tall), color)
            for n, (at, tall, color) in enumerate(bottles, start=1)
        ),
    )  # fmt: skip


def storage(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a wardrobe or larder, a hall cabinet when it is shallow, or open shelving at a depth between."""
    if _SHELF_DEPTH_M[0] < size[1] < _SHELF_DEPTH_M[1]:
        return _rack(size)
    width, depth, height = size
    doors = max(1, round(width / 0.5))
    y, low, high = depth / 2, 0.1, height - 0.04
    pitch = (width - 0.01) / doors
    # Doors open in pairs: each handle sits beside its neighbour's.
    knobs = [-width / 2 + pitch * (n + 1) - 0.04 if n % 2 == 0 else -width / 2 + pitch * n + 0.05 for n in range(doors)]
    handles = tuple(
        block(f"handle_{n}", (x - 0.01, x + 0.01), (y - 0.02, y), (0.95, 1.2), STEEL) for n, x in enumerate(knobs, 1)
    )
    back = (width, depth - 0.02, height)
    return (
        *(part.moved(-0.01) for part in _body(back, style)),
        *fronts(doors, 1, (-width / 2, width / 2), (low, high), y - 0.02, name="door"),
        *handles,
    )


def _rack(size: Size) -> tuple[Part, ...]:
    """Returns metal shelving with boxes on it."""
    width, depth, height = size
    x, y, post_m = width / 2, depth / 2, 0.03
    corners = ((-x, -y), (x - post_m, -y), (-x, y - post_m), (x - post_m, y - post_m))
    posts = tuple(
        block(f"post_{n}", (px, px + post_m), (py, py + post_m), (0.0, height), STEEL)
        for n, (px, py) in enumerate(corners, start=1)
    )
    levels = [0.18, 0.78, 1.38, height - 0.05]
    shelves = tuple(
        block(f"shelf_{n}", (-x + post_m, x - post_m), (-y, y), (z, z + 0.02), WHITE) for n, z in enumerate(levels, 1)
    )
    loads: tuple[tuple[float, float, float, float], ...] = (
        (-x + 0.08, 0.1 * width, levels[0], 0.35),
        (0.15 * width, x - 0.08, levels[0], 0.28),
        (-0.2 * width, x - 0.1, levels[1], 0.3),
        (-x + 0.1, 0.05 * width, levels[2], 0.32),
    )
    boxes = tuple(
        block(f"box_{n}", (left, right), (-y + 0.04, y - 0.04), (z + 0.02, z + 0.02 + tall), _BOXES[n % 2])
        for n, (left, right, z, tall) in enumerate(loads, start=1)
    )
    return (*posts, *shelves, *boxes)


def bookcase(size: Size, _style: Style) -> tuple[Part, ...]:
    """Returns a bookcase: back, sides, boards, and rows of books of different lengths."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    inner = (-x + _BOARD_M, x - _BOARD_M)
    pitch = (height - 0.06 - _BOARD_M) / 3
    levels = [0.06 + n * pitch for n in range(4)]
    boards = tuple(
        block(f"board_{n}", inner, (-y + 0.02, y), (z, z + _BOARD_M), WOOD) for n, z in enumerate(levels, start=1)
    )
    spans = ((0.0, 0.94), (0.0, 0.62), (0.3, 1.0))
    books = tuple(
        block(
            f"books_{n}",
            _share(inner, span),
            (-y + 0.04, y - 0.05),
            (levels[n - 1] + _BOARD_M, levels[n - 1] + _BOARD_M + 0.5 * pitch),
            _BOOKS[n - 1],
        )
        for n, span in enumerate(spans, start=1)
    )
    return (
        block("back", inner, (-y, -y + 0.02), (0.0, height), shaded(WOOD, 0.8)),
        block("side_left", (-x, -x + _BOARD_M), (-y, y), (0.0, height), WOOD),
        block("side_right", (x - _BOARD_M, x), (-y, y), (0.0, height), WOOD),
        *boards,
        *books,
    )


def corner_cabinet(size: Size, _style: Style) -> tuple[Part, ...]:
    """Returns an L of two wings for a corner that is behind it and on its left, with a door to each wing."""
    width, depth, height = size
    x, y, wing = width / 2, depth / 2, 0.4
    low, dark = 0.08, shaded(WOOD, 0.85)
    return (
        block("plinth_back", (-x, x - 0.03), (-y, -y + wing - 0.06), (0.0, low), DARK),
        block("plinth_left", (-x, -x + wing - 0.06), (-y + wing - 0.06, y - 0.03), (0.0, low), DARK),
        block("wing_back", (-x, x), (-y, -y + wing - 0.02), (low, height - 0.03), dark),
        block("wing_left", (-x, -x + wing - 0.02), (-y + wing - 0.02, y), (low, height - 0.03), dark),
        block("door_back", (-x + wing + 0.01, x - 0.01), (-y + wing - 0.02, -y + wing), (low, height - 0.06), FRONT),
        block("door_left", (-x + wing - 0.02, -x + wing), (-y + wing + 0.01, y - 0.01), (low, height - 0.06), FRONT),
        block("top_back", (-x, x), (-y, -y + wing), (height - 0.03, height), WOOD),
        block("top_left", (-x, -x + wing), (-y + wing, y), (height - 0.03, height), WOOD),
    )  # fmt: skip


def media_unit(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a low cabinet with a television on it."""
    width, depth, height = size
    low = (width, depth, 0.48)
    x = min(width / 2 - 0.05, 0.62)
    return (
        *_body(low, style, top=True),
        *fronts(3 if width > 1.5 else 2, 1, *_face(low), name="door"),
        block("foot", (-0.25, 0.25), (-0.1, 0.1), (0.48, 0.52), DARK),
        block("screen", (-x, x), (-0.03, 0.03), (0.52, height), SCREEN),
    )


def _body(size: Size, style: Style, *, top: bool = False) -> tuple[Part, ...]:
    """Returns what a cabinet stands on and its body, with room for fronts; a top reaches over them."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    under = height - _BOARD_M if top else height
    body = block("body", (-x, x), (-y, y - 0.02), (_STAND_M, under), shaded(WOOD, 0.72 if top else 0.85))
    board = block("top", (-x, x), (-y, y), (under, height), WOOD)
    return (*stand((width, depth), _STAND_M, style), body, *((board,) if top else ()))


def _face(size: Size) -> tuple[Range, Range, float]:
    """Returns where the fronts of a cabinet go: along x, along z, and how far out."""
    return (-size[0] / 2, size[0] / 2), (_STAND_M, size[2] - _BOARD_M), size[1] / 2


def _share(along: Range, span: Range) -> Range:
    length = along[1] - along[0]
    return along[0] + span[0] * length, along[0] + span[1] * length
