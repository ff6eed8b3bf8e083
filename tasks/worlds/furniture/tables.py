"""Tables, desks and serving carts."""

from tasks.worlds.furniture.furniture_type import (
    BOTTLE,
    CUSHION,
    DARK,
    FRONT,
    HALLS,
    SCREEN,
    SPIRIT,
    STEEL,
    WOOD,
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
    one_size,
    post,
    shade,
    usual_and_long,
)

DESK_TOP_M = 0.74
"""EN 527-1: fixed desks are 0.74 m high."""
_MIDDLE = (0.0, 0.0)


def dining_table(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a table on four legs, or on a column when it is as deep as wide and the room likes round tables."""
    width, depth, height = size
    if width == depth and style.round:
        return _pedestal_table(size, style, 0.45)
    x, y = width / 2, depth / 2
    top = block("top", (-x, x), (-y, y), (height - 0.04, height), WOOD)
    return (*legs((width, depth), height - 0.04, 0.06, shade(WOOD, 0.85)), top)


def coffee_table(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a low table with a shelf below its top, or a round one on three legs."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    if width == depth:
        reach = x - 0.12
        feet = ((0.0, reach), (-0.866 * reach, -0.5 * reach), (0.866 * reach, -0.5 * reach))
        dark = shade(WOOD, 0.7)
        rods = tuple(post(f"leg_{n}", at, 0.025, (0.0, height - 0.04), dark) for n, at in enumerate(feet, start=1))
        return (*rods, post("top", _MIDDLE, x, (height - 0.04, height), WOOD))
    return (
        *legs((width, depth), height - 0.04, 0.05, shade(WOOD, 0.85)),
        block("shelf", (-x + 0.07, x - 0.07), (-y + 0.02, y - 0.02), (0.12, 0.14), shade(WOOD, 0.9)),
        block("top", (-x, x), (-y, y), (height - 0.04, height), WOOD),
    )


def side_table(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a small table, round on a column or square on four legs."""
    if style.round:
        return _pedestal_table(size, style, 0.6)
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        *legs((width, depth), height - 0.03, 0.035, shade(WOOD, 0.85), 0.015),
        block("shelf", (-x + 0.05, x - 0.05), (-y + 0.02, y - 0.02), (0.15, 0.17), shade(WOOD, 0.9)),
        block("top", (-x, x), (-y, y), (height - 0.03, height), WOOD),
    )


def _pedestal_table(size: Size, _style: Style, foot: float) -> tuple[Primitive, ...]:
    radius, height = min(size[0], size[1]) / 2, size[2]
    dark = shade(WOOD, 0.7)
    return (
        post("foot", _MIDDLE, radius * foot, (0.0, 0.03), dark),
        post("column", _MIDDLE, 0.03 + 0.03 * (radius > 0.3), (0.03, height - 0.04), dark),
        post("top", _MIDDLE, radius, (height - 0.04, height), WOOD),
    )


def console_table(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a narrow table with a drawer, a low shelf, and a vase."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    top = height - 0.2
    return (
        *legs((width, depth), top - 0.03, 0.04, shade(WOOD, 0.85)),
        block("shelf", (-x + 0.06, x - 0.06), (-y + 0.02, y - 0.02), (0.15, 0.17), WOOD),
        block("drawer", (-x + 0.1, x - 0.1), (-y + 0.06, y - 0.03), (top - 0.13, top - 0.03), FRONT),
        block("top", (-x, x), (-y, y), (top - 0.03, top), WOOD),
        post("vase", (-x + 0.2, 0.0), 0.06, (top, height), CUSHION),
    )


def desk(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a desk: legs at one end, drawers at the other, a monitor and a keyboard."""
    width, depth, height = size
    x, y, top = width / 2, depth / 2, DESK_TOP_M
    under, pedestal = top - 0.03, (x - 0.42, x - 0.03)
    left = tuple(
        block(f"leg_{n}", (-x + 0.03, -x + 0.08), (at - 0.025, at + 0.025), (0.0, under), shade(WOOD, 0.8))
        for n, at in enumerate((-y + 0.06, y - 0.06), start=1)
    )
    screen = min(0.3, x - 0.45)
    return (
        *left,
        block("pedestal", pedestal, (-y + 0.03, y - 0.06), (0.0, under), shade(WOOD, 0.8)),
        *fronts(1, 3, pedestal, (0.04, under), y - 0.04, name="drawer"),
        block("top", (-x, x), (-y, y), (under, top), WOOD),
        block("foot", (-0.2, -0.04), (-y + 0.1, -y + 0.22), (top, top + 0.08), DARK),
        block("screen", (-0.12 - screen, -0.12 + screen), (-y + 0.15, -y + 0.18), (top + 0.08, height), SCREEN),
        block("keyboard", (-0.34, 0.1), (-0.02, 0.12), (top, top + 0.02), STEEL),
    )


def serving_cart(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a trolley: four posts, two trays, a handle, and bottles."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    corners = ((-x + 0.05, -y + 0.02), (x - 0.02, -y + 0.02), (-x + 0.05, y - 0.02), (x - 0.02, y - 0.02))
    rods = tuple(post(f"post_{n}", at, 0.015, (0.0, height - 0.03), STEEL) for n, at in enumerate(corners, start=1))
    high = height - 0.2
    return (
        *rods,
        block("tray_low", (-x + 0.07, x - 0.04), (-y + 0.04, y - 0.04), (0.18, 0.2), WOOD),
        block("tray_high", (-x + 0.07, x - 0.04), (-y + 0.04, y - 0.04), (high - 0.02, high), WOOD),
        block("handle", (-x, -x + 0.03), (-y, y), (height - 0.06, height - 0.03), STEEL),
        post("bottle_1", (0.08, 0.03), 0.04, (high, height), BOTTLE),
        post("bottle_2", (0.2, -0.05), 0.035, (high, height - 0.04), SPIRIT),
    )


TYPES = (
    FurnitureType(
        "DiningTables",
        dining_table,
        (
            Variant((0.8, 0.8), (0.0, 0.0), (0.75, 0.75), (0.0, 16.0)),
            Variant((1.0, 1.2), (0.0, 0.0), (0.75, 0.75), (12.0, 1e9)),
            Variant((1.2, 1.4), (0.8, 0.85), (0.75, 0.75)),
            Variant((1.6, 1.8), (0.9, 0.95), (0.75, 0.75), (14.0, 1e9)),
            Variant((2.0, 2.2), (0.95, 1.0), (0.75, 0.75), (22.0, 1e9)),
            Variant((2.4, 2.8), (1.1, 1.2), (0.75, 0.75), HALLS),
        ),
        front_m=0.8,
        anchor="center",
        spread_m2=11.0,
        group="dining table",
        rooms=(
            occasional("Living", 32.0, 2),
            essential("Dining", 1),
            occasional("Dining", 18.0, 2),
            likely("Kitchen", 20.0, 1),
        ),
    ),
    FurnitureType(
        "CoffeeTables",
        coffee_table,
        (Variant((0.7, 0.9), (0.0, 0.0), (0.4, 0.45)), Variant((0.9, 1.2), (0.5, 0.6), (0.4, 0.45))),
        front_m=0.45,
        anchor="center",
        taste=Taste(near=("Sofas",), middle=0.3),
    ),
    FurnitureType(
        "EndAndSideTables",
        side_table,
        one_size((0.4, 0.5), (0.0, 0.0), (0.5, 0.6)),
        front_m=0.2,
        spread_m2=4.0,
        taste=Taste(near=("Sofas", "LivingRoomChairs", "Beds"), corner=0.4),
    ),
    FurnitureType(
        "ConsoleTables",
        console_table,
        usual_and_long((0.9, 1.3), (0.3, 0.4), (1.0, 1.05), (1.6, 2.0)),
        taste=Taste(middle=0.4, chance=0.5, apart=True),
        rooms=(
            occasional("Living", 18.0, 1),
            occasional("Dining", 14.0, 1),
            essential("Hallway", 1),
            likely("Hallway", 10.0, 2),
        ),
    ),
    FurnitureType(
        "Desks",
        desk,
        usual_and_long((1.2, 1.6), (0.65, 0.8), (1.2, 1.2), (1.8, 2.0)),
        front_m=1.0,
        under_window=True,
        spread_m2=10.0,
        group="desk",
        rooms=(
            likely("Bedroom", 22.0, 2),
            occasional("Living", 30.0, 3),
        ),
    ),
    FurnitureType(
        "ServingCarts",
        serving_cart,
        one_size((0.7, 0.9), (0.4, 0.45), (0.95, 1.05)),
        front_m=0.4,
        spread_m2=10.0,
        taste=Taste(corner=0.3, near=("DiningTables",)),
        rooms=(
            likely("Dining", 16.0, 4),
            occasional("Kitchen", 20.0, 1),
        ),
    ),
)
