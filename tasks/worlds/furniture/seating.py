"""What sofas, chairs, ottomans and benches are made of."""

import math

from tasks.worlds.furniture.primitives import (
    BASKET,
    CUSHION,
    DARK,
    FABRIC,
    STEEL,
    WOOD,
    Part,
    Size,
    Style,
    block,
    legs,
    post,
    runners,
    shaded,
)

_CHAIR_SEAT_M = 0.46  # EN 1335-1 and Neufert: seats of 0.42 to 0.48 m
_LEG_M = 0.04


def sofa(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a sofa: feet, base, back, two arms, and a cushion for each seat."""
    arm = 0.18
    seats = max(2, round((size[0] - 2 * arm) / 0.65))
    return _upholstered(size, style, arm, seats)


def armchair(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns an upholstered chair with arms."""
    return _upholstered(size, style, 0.14, 1)


def _upholstered(size: Size, _style: Style, arm: float, seats: int) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    foot, seat, back = 0.1, 0.3, 0.2
    pitch = (width - 2 * arm) / seats
    dark = shaded(FABRIC, 0.88)
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
        *runners((width, depth), foot, shaded(WOOD, 0.7), 0.07),
        block("base", (-x + arm, x - arm), (-y + back, y - 0.02), (foot, seat), dark),
        block("back", (-x + arm, x - arm), (-y, -y + back), (foot, height), FABRIC),
        block("arm_left", (-x, -x + arm), (-y, y - 0.02), (foot, 0.6), FABRIC),
        block("arm_right", (x - arm, x), (-y, y - 0.02), (foot, 0.6), FABRIC),
        *cushions,
    )


def dining_chair(size: Size, _style: Style) -> tuple[Part, ...]:
    """Returns a chair: two front legs, two that run up the back, a seat, and a backrest between them."""
    width, depth, height = size
    x, y, seat = width / 2, depth / 2, _CHAIR_SEAT_M
    wood = shaded(WOOD, 0.85)
    return (
        block("leg_1", (-x, -x + _LEG_M), (-y, -y + _LEG_M), (0.0, height), wood),
        block("leg_2", (x - _LEG_M, x), (-y, -y + _LEG_M), (0.0, height), wood),
        block("leg_3", (-x, -x + _LEG_M), (y - _LEG_M, y), (0.0, seat - 0.05), wood),
        block("leg_4", (x - _LEG_M, x), (y - _LEG_M, y), (0.0, seat - 0.05), wood),
        block("seat", (-x, x), (-y + _LEG_M, y), (seat - 0.05, seat), CUSHION),
        block("back", (-x + _LEG_M, x - _LEG_M), (-y + 0.01, -y + 0.03), (height - 0.3, height - 0.02), wood),
    )


def desk_chair(size: Size, _style: Style) -> tuple[Part, ...]:
    """Returns a swivel chair on a star of five spokes, as EN 1335 asks for."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    reach = min(x, y) - 0.03
    angles = [(0.25 + 0.4 * n) * math.pi for n in range(5)]
    middle = (reach + 0.04) / 2
    spokes = tuple(
        Part(
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


def ottoman(size: Size, style: Style) -> tuple[Part, ...]:
    """Returns a footstool, round or square, on a base a little smaller than it."""
    x, y, height = size[0] / 2, size[1] / 2, size[2]
    dark = shaded(WOOD, 0.7)
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


def storage_bench(size: Size, _style: Style) -> tuple[Part, ...]:
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
