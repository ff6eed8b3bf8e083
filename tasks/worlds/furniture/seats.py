"""Seats: sofas, chairs, ottomans and benches."""

import math

from tasks.worlds.furniture.furniture_type import (
    BASKET,
    CUSHION,
    DARK,
    FABRIC,
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
    legs,
    likely,
    occasional,
    one_size,
    post,
    runners,
    shade,
    usual_and_long,
)

_CHAIR_SEAT_M = 0.46  # EN 1335-1 and Neufert: seats of 0.42 to 0.48 m
_LEG_M = 0.04


def sofa(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a sofa: feet, base, back, two arms, and a cushion for each seat."""
    arm = 0.18
    seats = max(2, round((size[0] - 2 * arm) / 0.65))
    return _upholstery(size, style, arm, seats)


def armchair(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns an upholstered chair with arms."""
    return _upholstery(size, style, 0.14, 1)


def _upholstery(size: Size, _style: Style, arm: float, seats: int) -> tuple[Primitive, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    foot, seat, back = 0.1, 0.3, 0.2
    pitch = (width - 2 * arm) / seats
    dark = shade(FABRIC, 0.88)
    cushions = tuple(
        block(
            f"cushion_{n + 1}",
            (-x + arm + n * pitch + 0.01, -x + arm + (n + 1) * pitch - 0.01),
            (-y + back, y + 0.0),
            (seat, seat + 0.14),
            CUSHION,
        )
        for n in range(seats)
    )
    return (
        *runners((width, depth), foot, shade(WOOD, 0.7), 0.07),
        block("base", (-x + arm, x - arm), (-y + back, y - 0.02), (foot, seat), dark),
        block("back", (-x + arm, x - arm), (-y, -y + back), (foot, height), FABRIC),
        block("arm_left", (-x, -x + arm), (-y, y - 0.02), (foot, 0.6), FABRIC),
        block("arm_right", (x - arm, x), (-y, y - 0.02), (foot, 0.6), FABRIC),
        *cushions,
    )


def dining_chair(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a chair: two front legs, two that run up the back, a seat, and a backrest between them."""
    width, depth, height = size
    x, y, seat = width / 2, depth / 2, _CHAIR_SEAT_M
    wood = shade(WOOD, 0.85)
    return (
        block("leg_1", (-x, -x + _LEG_M), (-y, -y + _LEG_M), (0.0, height), wood),
        block("leg_2", (x - _LEG_M, x), (-y, -y + _LEG_M), (0.0, height), wood),
        block("leg_3", (-x, -x + _LEG_M), (y - _LEG_M, y), (0.0, seat - 0.05), wood),
        block("leg_4", (x - _LEG_M, x), (y - _LEG_M, y), (0.0, seat - 0.05), wood),
        block("seat", (-x, x), (-y + _LEG_M, y), (seat - 0.05, seat), CUSHION),
        block("back", (-x + _LEG_M, x - _LEG_M), (-y + 0.01, -y + 0.03), (height - 0.3, height - 0.02), wood),
    )


def desk_chair(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a swivel chair on a star of five spokes, as EN 1335 asks for."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    reach = min(x, y) - 0.03
    angles = [(0.25 + 0.4 * n) * math.pi for n in range(5)]
    middle = (reach + 0.04) / 2
    spokes = tuple(
        Primitive(
            f"spoke_{n}",
            "box",
            (middle * math.cos(angle), middle * math.sin(angle), 0.03),
            ((reach - 0.04) / 2, 0.02, 0.03),
            DARK,
            angle,
        )
        for n, angle in enumerate(angles, start=1)
    )
    return (
        *spokes,
        post("column", (0.0, 0.0), 0.03, (0.02, 0.42), STEEL),
        block("seat", (-x + 0.06, x - 0.06), (-y + 0.08, y - 0.04), (0.42, 0.5), FABRIC),
        block("stem", (-0.04, 0.04), (-y + 0.03, -y + 0.06), (0.42, height - 0.3), DARK),
        block("back", (-x + 0.08, x - 0.08), (-y + 0.06, -y + 0.1), (0.55, height), FABRIC),
    )


def ottoman(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a footstool, round or square, on a base a little smaller than it."""
    x, y, height = size[0] / 2, size[1] / 2, size[2]
    dark = shade(WOOD, 0.7)
    if style.round:
        radius = min(x, y)
        return (
            post("base", (0.0, 0.0), radius - 0.05, (0.0, 0.08), dark),
            post("seat", (0.0, 0.0), radius, (0.08, height - 0.1), FABRIC),
            post("cushion", (0.0, 0.0), radius - 0.01, (height - 0.1, height), CUSHION),
        )
    return (
        *legs((size[0], size[1]), 0.12, 0.04, dark, 0.03),
        block("seat", (-x, x), (-y, y), (0.12, height - 0.1), FABRIC),
        block("cushion", (-x + 0.01, x - 0.01), (-y + 0.01, y - 0.01), (height - 0.1, height), CUSHION),
    )


def storage_bench(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a bench whose open compartments hold baskets, with a cushion on top."""
    width, depth, height = size
    x, y, board = width / 2, depth / 2, 0.03
    shelf, seat = 0.1, height - 0.1
    basket = BASKET
    return (
        block("side_left", (-x, -x + board), (-y, y), (0.0, seat), WOOD),
        block("side_right", (x - board, x), (-y, y), (0.0, seat), WOOD),
        block("shelf", (-x + board, x - board), (-y, y), (shelf - board, shelf), WOOD),
        block("basket_left", (-x + 0.06, -0.03), (-y + 0.03, y - 0.02), (shelf, seat - 0.06), basket),
        block("basket_right", (0.03, x - 0.06), (-y + 0.03, y - 0.02), (shelf, seat - 0.06), basket),
        block("divider", (-0.015, 0.015), (-y, y), (shelf, seat), WOOD),
        block("seat", (-x, x), (-y, y), (seat, seat + 0.03), WOOD),
        block("cushion", (-x + 0.01, x - 0.01), (-y + 0.01, y - 0.01), (seat + 0.03, height), CUSHION),
    )


TYPES = (
    FurnitureType(
        "Sofas",
        sofa,
        (
            Variant((1.6, 1.7), (0.85, 0.9), (0.8, 0.85)),
            Variant((2.0, 2.3), (0.9, 0.95), (0.8, 0.85), (14.0, 1e9)),
            Variant((2.5, 2.7), (0.95, 1.0), (0.8, 0.85), (26.0, 1e9)),
        ),
        front_m=0.8,
        under_window=True,
        spread_m2=11.0,
        group="sofa",
        rooms=(
            occasional("Bedroom", 45.0, 5),
            essential("Living", 1),
            occasional("Living", 20.0, 5),
        ),
    ),
    FurnitureType(
        "LivingRoomChairs",
        armchair,
        one_size((0.75, 0.85), (0.75, 0.85), (0.8, 0.95)),
        front_m=0.5,
        spread_m2=5.0,
        group="armchair",
        rooms=(
            likely("Bedroom", 14.0, 3),
            likely("Living", 9.0, 1),
            occasional("Dining", 12.0, 5),
            occasional("Hallway", 14.0, 4),
        ),
    ),
    FurnitureType(
        "DiningChairs",
        dining_chair,
        one_size((0.45, 0.45), (0.5, 0.5), (0.85, 0.95)),
        front_m=0.4,
        spread_m2=2.5,
        taste=Taste(near=("DiningTables",), corner=0.3, chance=0.6),
    ),
    FurnitureType(
        "DeskChairs",
        desk_chair,
        one_size((0.6, 0.65), (0.6, 0.65), (0.9, 1.0)),
        front_m=0.4,
        spread_m2=6.0,
        taste=Taste(near=("Desks",), chance=0.6),
    ),
    FurnitureType(
        "Ottomans",
        ottoman,
        one_size((0.5, 0.6), (0.0, 0.0), (0.4, 0.45)),
        front_m=0.3,
        spread_m2=5.0,
        taste=Taste(near=("LivingRoomChairs", "Sofas"), chance=0.4, apart=True),
        rooms=(
            occasional("Bedroom", 24.0, 3),
            occasional("Bathroom", 30.0, 5),
            likely("Living", 14.0, 5),
            occasional("Hallway", 12.0, 5),
            occasional("Closet", 20.0, 4),
        ),
    ),
    FurnitureType(
        "StorageBenches",
        storage_bench,
        usual_and_long((0.9, 1.3), (0.4, 0.45), (0.45, 0.5), (1.6, 2.0)),
        front_m=0.5,
        under_window=True,
        spread_m2=6.0,
        taste=Taste(middle=0.2, window=0.4, chance=0.5),
        rooms=(
            occasional("Bedroom", 22.0, 2),
            occasional("Bathroom", 12.0, 4),
            occasional("Living", 26.0, 6),
            occasional("Dining", 16.0, 6),
            essential("Hallway", 1),
            likely("Hallway", 9.0, 1),
            occasional("Closet", 12.0, 1),
        ),
    ),
)
