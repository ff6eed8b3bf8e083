"""Beds and floor lamps."""

from tasks.worlds.furniture.furniture_type import (
    CUSHION,
    DARK,
    FABRIC,
    LINEN,
    WHITE,
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
    shade,
)

_FRAME_M = 0.05
_HEAD_M = 0.06
_BASE_M = 0.16
_SLATS_M = 0.3
_MATTRESS_TOP_M = 0.5  # Neufert: beds are 0.4 to 0.55 m high


def bed(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a bed: headboard, legs or base, frame, mattress, blanket, and a pillow for each sleeper."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    back = -y + _HEAD_M
    side = x - _FRAME_M
    blanket = back + 0.6
    return (
        block("headboard", (-x, x), (-y, back), (0.0, height), WOOD),
        *_bed_base(width, depth, style),
        block("frame", (-x, x), (back, y), (_BASE_M, _SLATS_M), WOOD),
        block("mattress", (-side, side), (back, y - 0.04), (_SLATS_M, _MATTRESS_TOP_M), LINEN),
        block("blanket", (-side, side), (blanket, y - 0.04), (_MATTRESS_TOP_M, _MATTRESS_TOP_M + 0.05), CUSHION),
        block("throw", (-side, side), (y - 0.6, y - 0.2), (_MATTRESS_TOP_M + 0.05, _MATTRESS_TOP_M + 0.07), FABRIC),
        *_pillows(side, back),
    )  # fmt: skip


def _bed_base(width: float, depth: float, style: Style) -> tuple[Primitive, ...]:
    dark = shade(WOOD, 0.7)
    if style.raised:
        return legs((width, depth - 2 * _HEAD_M), _BASE_M, 0.06, dark, 0.03)
    x, y = width / 2, depth / 2
    return (block("base", (-x + 0.08, x - 0.08), (-y + _HEAD_M, y - 0.1), (0.0, _BASE_M), dark),)


def _pillows(side: float, back: float) -> tuple[Primitive, ...]:
    """Returns one pillow on a narrow bed, else two."""
    y, z = (back + 0.04, back + 0.5), (_MATTRESS_TOP_M, _MATTRESS_TOP_M + 0.12)
    if side < 0.6:
        return (block("pillow", (-side + 0.1, side - 0.1), y, z, WHITE),)
    return (
        block("pillow_left", (-side + 0.06, -0.04), y, z, WHITE),
        block("pillow_right", (0.04, side - 0.06), y, z, WHITE),
    )


def floor_lamp(size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns a standing lamp: foot, pole, and a shade at its top."""
    radius, height = min(size[0], size[1]) / 2, size[2]
    return (
        post("foot", (0.0, 0.0), 0.75 * radius, (0.0, 0.03), DARK),
        post("pole", (0.0, 0.0), 0.015, (0.03, height - 0.28), DARK),
        post("shade", (0.0, 0.0), radius, (height - 0.28, height), shade(LINEN, 1.02) if style.round else CUSHION),
    )


TYPES = (
    FurnitureType(
        "Beds",
        bed,
        (
            Variant((1.0, 1.0), (2.1, 2.1), (0.85, 1.0)),
            Variant((1.5, 1.5), (2.1, 2.1), (0.95, 1.1), (11.0, 1e9)),
            Variant((1.7, 1.7), (2.1, 2.1), (0.95, 1.1), (12.0, 1e9)),
            Variant((1.9, 1.9), (2.1, 2.1), (0.95, 1.1), (15.0, 1e9)),
        ),
        front_m=0.7,
        under_window=True,
        spread_m2=14.0,
        group="bed",
        rooms=(
            essential("Bedroom", 1),
            occasional("Bedroom", 24.0, 4),
        ),
    ),
    FurnitureType(
        "FloorLamps",
        floor_lamp,
        one_size((0.35, 0.4), (0.0, 0.0), (1.5, 1.7)),
        front_m=0.1,
        anchor="corner",
        spread_m2=6.0,
        taste=Taste(corner=1.0, near=("Sofas", "LivingRoomChairs", "Desks"), apart=True),
        rooms=(
            likely("Bedroom", 16.0, 4),
            likely("Living", 12.0, 4),
            likely("Dining", 12.0, 3),
            likely("Hallway", 10.0, 3),
        ),
    ),
)
