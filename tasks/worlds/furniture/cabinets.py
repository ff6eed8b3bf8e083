"""Cabinets: chests, nightstands, sideboards, bars, corner cabinets and media units."""

from tasks.worlds.furniture.furniture_type import (
    BOTTLE,
    CUSHION,
    DARK,
    FRONT,
    SCREEN,
    SPIRIT,
    STEEL,
    WOOD,
    FurnitureType,
    Primitive,
    Size,
    Style,
    Taste,
    block,
    cabinet_body,
    essential,
    front_face,
    fronts,
    likely,
    occasional,
    one_size,
    post,
    shade,
    usual_and_long,
)


def chest(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a chest of drawers, two columns when it is wide."""
    width, _, height = size
    rows = 4 if height > 0.95 else 3
    drawers = fronts(2 if width > 1.0 else 1, rows, *front_face(size), name="drawer")
    return (*cabinet_body(size, style, top=True), *drawers)


def nightstand(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a small cabinet with two drawers and a book on it."""
    y, height = size[1] / 2, size[2] - 0.04
    low = (size[0], size[1], height)
    return (
        *cabinet_body(low, style),
        *fronts(1, 2, *front_face(low), name="drawer"),
        block("book", (-0.12, 0.1), (-y + 0.1, y - 0.1), (height, size[2]), CUSHION),
    )


def sideboard(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a long low cabinet with three or four doors and a bowl on top."""
    width, depth, height = size
    low = (width, depth, height - 0.1)
    return (
        *cabinet_body(low, style, top=True),
        *fronts(4 if width > 1.5 else 3, 1, *front_face(low), name="door"),
        post("bowl", (0.2 * width, 0.0), 0.14, (height - 0.1, height), CUSHION),
    )


def bar_cabinet(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a high cabinet with two doors, and bottles on its top."""
    width, depth, height = size
    low = (width, depth, height - 0.28)
    bottles = (((-0.3, 0.0), 0.28, BOTTLE), ((-0.18, 0.05), 0.24, SPIRIT), ((0.2, 0.0), 0.14, STEEL))
    return (
        *cabinet_body(low, style, top=True),
        *fronts(2, 1, *front_face(low), name="door"),
        *(
            post(f"bottle_{n}", at, 0.04 if tall > 0.2 else 0.09, (low[2], low[2] + tall), color)
            for n, (at, tall, color) in enumerate(bottles, start=1)
        ),
    )  # fmt: skip


def corner_cabinet(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns an L of two wings for a corner that is behind it and on its left, with a door to each wing."""
    width, depth, height = size
    x, y, wing = width / 2, depth / 2, 0.4
    low, dark = 0.08, shade(WOOD, 0.85)
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


def media_unit(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a low cabinet with a television on it."""
    width, depth, height = size
    low = (width, depth, 0.48)
    x = min(width / 2 - 0.05, 0.62)
    return (
        *cabinet_body(low, style, top=True),
        *fronts(3 if width > 1.5 else 2, 1, *front_face(low), name="door"),
        block("foot", (-0.25, 0.25), (-0.1, 0.1), (0.48, 0.52), DARK),
        block("screen", (-x, x), (-0.03, 0.03), (0.52, height), SCREEN),
    )


TYPES = (
    FurnitureType(
        "Dressers",
        chest,
        usual_and_long((0.8, 1.4), (0.45, 0.5), (0.8, 1.0), (1.6, 1.8)),
        front_m=0.7,
        taste=Taste(middle=0.3, near=("Beds",), chance=0.5),
        rooms=(
            likely("Bedroom", 18.0, 1),
            occasional("Hallway", 12.0, 2),
            likely("Closet", 9.0, 2),
        ),
    ),
    FurnitureType(
        "Nightstands",
        nightstand,
        one_size((0.4, 0.5), (0.35, 0.4), (0.5, 0.6)),
        front_m=0.3,
        spread_m2=5.0,
        taste=Taste(near=("Beds",), corner=0.3),
    ),
    FurnitureType(
        "SideboardsAndBuffets",
        sideboard,
        usual_and_long((1.2, 1.8), (0.4, 0.5), (0.9, 0.95), (2.0, 2.4)),
        front_m=0.7,
        spread_m2=9.0,
        taste=Taste(middle=0.5, near=("DiningTables",)),
        rooms=(
            likely("Living", 16.0, 3),
            essential("Dining", 2),
            occasional("Dining", 12.0, 4),
            occasional("Kitchen", 14.0, 3),
            occasional("Hallway", 12.0, 3),
        ),
    ),
    FurnitureType(
        "BarCabinets",
        bar_cabinet,
        usual_and_long((0.8, 1.2), (0.4, 0.45), (1.2, 1.35), (1.6, 2.0)),
        spread_m2=12.0,
        taste=Taste(corner=0.3, near=("DiningTables", "Sofas")),
        rooms=(
            occasional("Living", 28.0, 4),
            likely("Dining", 16.0, 1),
            occasional("Kitchen", 24.0, 4),
        ),
    ),
    FurnitureType(
        "CornerCabinets",
        corner_cabinet,
        one_size((0.8, 0.9), (0.8, 0.9), (1.7, 1.9)),
        front_m=0.5,
        anchor="corner",
        spread_m2=12.0,
        taste=Taste(corner=1.0),
        rooms=(
            occasional("Bathroom", 30.0, 1),
            likely("Dining", 20.0, 2),
        ),
    ),
    FurnitureType(
        "MediaStorage",
        media_unit,
        one_size((1.2, 1.8), (0.4, 0.45), (1.2, 1.25)),
        front_m=0.8,
        spread_m2=16.0,
        group="television",
        rooms=(essential("Living", 2),),
    ),
)
