"""Shelves and high storage: wardrobes, larders, open shelving and bookcases."""

from tasks.worlds.furniture.furniture_type import (
    BASKET,
    BOARD_M,
    STEEL,
    WHITE,
    WOOD,
    FurnitureType,
    Paint,
    Primitive,
    Range,
    Size,
    Style,
    Taste,
    Variant,
    block,
    cabinet_body,
    essential,
    fronts,
    likely,
    occasional,
    shade,
    usual_and_long,
)

_BOOKS = (Paint("", (0.48, 0.2, 0.17)), Paint("", (0.2, 0.3, 0.42)), Paint("", (0.82, 0.72, 0.5)))
_BOXES = (BASKET, shade(STEEL, 0.85))
_SHELF_DEPTH_M = (0.4, 0.55)


def storage(size: Size, style: Style) -> tuple[Primitive, ...]:
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
        *(part.moved(-0.01) for part in cabinet_body(back, style)),
        *fronts(doors, 1, (-width / 2, width / 2), (low, high), y - 0.02, name="door"),
        *handles,
    )


def _rack(size: Size) -> tuple[Primitive, ...]:
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


def bookcase(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a bookcase: back, sides, boards, and rows of books of different lengths."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    inner = (-x + BOARD_M, x - BOARD_M)
    pitch = (height - 0.06 - BOARD_M) / 3
    levels = [0.06 + n * pitch for n in range(4)]
    boards = tuple(
        block(f"board_{n}", inner, (-y + 0.02, y), (z, z + BOARD_M), WOOD) for n, z in enumerate(levels, start=1)
    )
    spans = ((0.0, 0.94), (0.0, 0.62), (0.3, 1.0))
    books = tuple(
        block(
            f"books_{n}",
            _share(inner, span),
            (-y + 0.04, y - 0.05),
            (levels[n - 1] + BOARD_M, levels[n - 1] + BOARD_M + 0.5 * pitch),
            _BOOKS[n - 1],
        )
        for n, span in enumerate(spans, start=1)
    )
    return (
        block("back", inner, (-y, -y + 0.02), (0.0, height), shade(WOOD, 0.8)),
        block("side_left", (-x, -x + BOARD_M), (-y, y), (0.0, height), WOOD),
        block("side_right", (x - BOARD_M, x), (-y, y), (0.0, height), WOOD),
        *boards,
        *books,
    )


def _share(along: Range, span: Range) -> Range:
    length = along[1] - along[0]
    return along[0] + span[0] * length, along[0] + span[1] * length


TYPES = (
    FurnitureType(
        "Storage",
        storage,
        (
            Variant((0.8, 1.2), (0.35, 0.4), (1.8, 2.0)),
            Variant((0.8, 1.2), (0.45, 0.5), (1.8, 2.0)),
            Variant((0.6, 0.6), (0.6, 0.6), (2.0, 2.1)),
            Variant((1.0, 1.0), (0.6, 0.6), (2.0, 2.1)),
            Variant((1.5, 1.5), (0.6, 0.6), (2.0, 2.1)),
            Variant((2.0, 2.0), (0.6, 0.6), (2.0, 2.1), (14.0, 1e9)),
        ),
        front_m=0.8,
        row=True,
        spread_m2=3.0,
        taste=Taste(corner=0.9, away=0.1),
        group="storage",
        rooms=(
            essential("Bedroom", 2),
            likely("Bedroom", 9.0, 5),
            likely("Bathroom", 8.0, 4),
            occasional("Living", 16.0, 7),
            occasional("Dining", 12.0, 7),
            likely("Kitchen", 9.0, 3),
            essential("Hallway", 2),
            likely("Hallway", 6.0, 4),
            essential("Closet", 1),
            likely("Closet", 2.5, 1),
        ),
    ),
    FurnitureType(
        "Bookcases",
        bookcase,
        usual_and_long((0.8, 1.2), (0.3, 0.35), (1.8, 2.0), (1.6, 2.0)),
        row=True,
        spread_m2=5.0,
        taste=Taste(corner=0.6),
        rooms=(
            occasional("Bedroom", 14.0, 1),
            likely("Living", 8.0, 2),
            occasional("Dining", 9.0, 3),
            occasional("Kitchen", 20.0, 8),
            occasional("Hallway", 7.0, 1),
            occasional("Closet", 7.0, 2),
        ),
    ),
)
