"""Kitchen units in modules of 0.6 m under one worktop at 0.9 m (EN 1116), and islands."""

from tasks.worlds.furniture.furniture_type import (
    BASKET,
    DARK,
    FRONT,
    HALLS,
    IRON,
    SCREEN,
    STEEL,
    WHITE,
    WOOD,
    WORKTOP,
    FurnitureType,
    Primitive,
    Size,
    Style,
    Taste,
    Variant,
    block,
    essential,
    fronts,
    legs,
    likely,
    occasional,
    post,
    shade,
)

WORKTOP_M = 0.9
MODULE_M = 0.6
_SLAB_M = 0.04
_PLINTH_M = 0.12
_UNDER_M = WORKTOP_M - _SLAB_M


def fridge(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a fridge above a freezer, or side by side when it is wide."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    body = (
        block("plinth", (-x + 0.02, x - 0.02), (-y, y - 0.08), (0.0, 0.06), DARK),
        block("body", (-x, x), (-y, y - 0.06), (0.06, height), shade(STEEL, 0.85)),
    )
    face, out = (y - 0.06, y - 0.03), (y - 0.03, y)
    if width > 0.8:
        return (
            *body,
            block("door_left", (-x, -0.005), face, (0.08, height), STEEL),
            block("door_right", (0.005, x), face, (0.08, height), STEEL),
            block("handle_left", (-0.06, -0.03), out, (0.7, 1.4), DARK),
            block("handle_right", (0.03, 0.06), out, (0.7, 1.4), DARK),
        )
    split = 0.36 * height
    return (
        *body,
        block("freezer_door", (-x, x), face, (0.08, split), WHITE),
        block("door", (-x, x), face, (split + 0.01, height), WHITE),
        block("freezer_handle", (-x + 0.05, -x + 0.08), out, (split - 0.25, split - 0.03), DARK),
        block("handle", (-x + 0.05, -x + 0.08), out, (split + 0.05, split + 0.45), DARK),
    )


def oven(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns an oven under a hob with four rings; a wide one has a unit of drawers beside it."""
    width, depth, _ = size
    x, y = width / 2, depth / 2
    left = (-x, -x + MODULE_M)
    middle = -x + MODULE_M / 2
    rings = tuple(
        post(f"ring_{n}", (middle + dx, dy - 0.01), radius, (WORKTOP_M + 0.01, WORKTOP_M + 0.02), IRON)
        for n, (dx, dy, radius) in enumerate(
            ((-0.13, -0.11, 0.08), (0.13, -0.11, 0.1), (-0.13, 0.12, 0.1), (0.13, 0.12, 0.08)), start=1
        )
    )
    drawers = fronts(1, 2, (-x + MODULE_M, x), (_PLINTH_M, _UNDER_M), y - 0.03, name="drawer")
    return (
        *_base(size, style),
        block("door", (left[0] + 0.01, left[1] - 0.01), (y - 0.05, y - 0.03), (0.16, 0.7), STEEL),
        block("window", (left[0] + 0.08, left[1] - 0.08), (y - 0.03, y - 0.02), (0.25, 0.58), SCREEN),
        block("handle", (left[0] + 0.06, left[1] - 0.06), (y - 0.03, y), (0.63, 0.65), STEEL),
        block("panel", (left[0] + 0.01, left[1] - 0.01), (y - 0.05, y - 0.03), (0.72, 0.85), DARK),
        *(drawers if width > MODULE_M else ()),
        block("hob", (left[0] + 0.03, left[1] - 0.03), (-y + 0.05, y - 0.06), (WORKTOP_M, WORKTOP_M + 0.01), SCREEN),
        *rings,
    )


def dishwasher(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a dishwasher under the worktop; a wide one has the sink beside it."""
    width, depth, _ = size
    x, y = width / 2, depth / 2
    left = (-x, -x + MODULE_M)
    machine = (
        block("door", (left[0] + 0.01, left[1] - 0.01), (y - 0.05, y - 0.03), (_PLINTH_M + 0.01, 0.72), STEEL),
        block("panel", (left[0] + 0.01, left[1] - 0.01), (y - 0.05, y - 0.03), (0.73, 0.85), DARK),
        block("handle", (left[0] + 0.08, left[1] - 0.08), (y - 0.03, y), (0.68, 0.7), DARK),
    )
    if width <= MODULE_M:
        return (*_base(size, style), *machine)
    right = (-x + MODULE_M, x)
    tap = (right[0] + right[1]) / 2
    return (
        *_base(size, style),
        *machine,
        *fronts(1, 1, right, (_PLINTH_M, _UNDER_M), y - 0.03, name="sink_door"),
        block("sink", (right[0] + 0.05, right[1] - 0.05), (-y + 0.14, y - 0.08), (WORKTOP_M, WORKTOP_M + 0.01), STEEL),
        block(
            "basin",
            (right[0] + 0.08, right[1] - 0.08),
            (-y + 0.17, y - 0.11),
            (WORKTOP_M + 0.01, WORKTOP_M + 0.02),
            shade(STEEL, 0.56),
        ),
        post("tap", (tap, -y + 0.09), 0.02, (WORKTOP_M, WORKTOP_M + 0.25), STEEL),
        block("spout", (tap - 0.015, tap + 0.015), (-y + 0.11, -y + 0.28), (WORKTOP_M + 0.22, WORKTOP_M + 0.25), STEEL),
    )


def _base(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns plinth, body and worktop of a row's unit; the worktop runs on into its neighbour's."""
    x, y = size[0] / 2, size[1] / 2
    return (
        block("plinth", (-x, x), (-y, y - 0.1), (0.0, _PLINTH_M), DARK),
        block("body", (-x, x), (-y, y - 0.05), (_PLINTH_M, _UNDER_M), shade(FRONT, 0.6)),
        block("worktop", (-x, x), (-y, y - 0.01), (_UNDER_M, WORKTOP_M), WORKTOP),
    )


def island(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns an island with fronts on both long sides, or a butcher's cart when it is small."""
    width, depth, height = size
    if width < 1.1:
        return _cart(size, style)
    x, y = width / 2, depth / 2
    out = y - 0.04
    doors = fronts(3, 1, (-x + 0.04, x - 0.04), (_PLINTH_M, height - _SLAB_M), out, name="door")
    return (
        block("plinth", (-x + 0.08, x - 0.08), (-y + 0.12, y - 0.12), (0.0, _PLINTH_M), DARK),
        block(
            "body",
            (-x + 0.04, x - 0.04),
            (-y + 0.06, out - 0.02),
            (_PLINTH_M, height - _SLAB_M),
            shade(FRONT, 0.6),
        ),
        *doors,
        block("panel", (-x + 0.04, x - 0.04), (-y + 0.04, -y + 0.06), (_PLINTH_M, height - _SLAB_M), FRONT),
        block("worktop", (-x, x), (-y, y), (height - _SLAB_M, height), WORKTOP),
    )


def _cart(size: Size, _style: Style) -> tuple[Primitive, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        *legs((width, depth), height - 0.05, 0.05, WOOD),
        block("shelf_low", (-x + 0.07, x - 0.07), (-y + 0.03, y - 0.03), (0.16, 0.18), WOOD),
        block("drawer", (-x + 0.07, x - 0.07), (-y + 0.03, y - 0.03), (height - 0.22, height - 0.05), FRONT),
        block("top", (-x, x), (-y, y), (height - 0.05, height), shade(WOOD, 1.1)),
        block("crate", (-x + 0.12, 0.05), (-y + 0.08, y - 0.08), (0.18, 0.4), BASKET),
    )


TYPES = (
    FurnitureType(
        "Fridges",
        fridge,
        (
            Variant((0.6, 0.7), (0.65, 0.65), (1.75, 1.85)),
            Variant((0.9, 0.9), (0.7, 0.7), (1.8, 1.8), (18.0, 1e9)),
        ),
        front_m=0.9,
        row=True,
        spread_m2=16.0,
        group="kitchen row",
        rooms=(
            essential("Kitchen", 3),
            occasional("Kitchen", 26.0, 5),
        ),
    ),
    FurnitureType(
        "DishWashers",
        dishwasher,
        (Variant((0.6, 0.6), (0.6, 0.6), (0.9, 0.9)), Variant((1.2, 1.4), (0.6, 0.6), (1.15, 1.15), (10.0, 1e9))),
        front_m=0.9,
        under_window=True,
        row=True,
        spread_m2=14.0,
        group="kitchen row",
        rooms=(
            essential("Kitchen", 2),
            occasional("Kitchen", 18.0, 7),
        ),
    ),
    FurnitureType(
        "Ovens",
        oven,
        (Variant((0.6, 0.6), (0.6, 0.6), (0.92, 0.92)), Variant((1.2, 1.4), (0.6, 0.6), (0.92, 0.92), (10.0, 1e9))),
        front_m=0.9,
        row=True,
        spread_m2=14.0,
        group="kitchen row",
        rooms=(
            essential("Kitchen", 1),
            occasional("Kitchen", 18.0, 6),
        ),
    ),
    FurnitureType(
        "KitchenIslandsAndCarts",
        island,
        (
            Variant((0.8, 0.9), (0.5, 0.5), (0.9, 0.9), (0.0, 18.0)),
            Variant((1.2, 1.8), (0.8, 1.0), (0.9, 0.9), (13.0, 1e9)),
            Variant((2.0, 2.4), (1.0, 1.2), (0.9, 0.9), HALLS),
        ),
        front_m=0.9,
        anchor="center",
        spread_m2=14.0,
        taste=Taste(middle=0.8),
        rooms=(likely("Kitchen", 20.0, 2),),
    ),
)
