"""Bathroom furniture: toilets, washbasins, showers, baths and laundry machines."""

from tasks.worlds.furniture.furniture_type import (
    DARK,
    FRONT,
    GLASS,
    HALLS,
    PORCELAIN,
    SCREEN,
    STEEL,
    WATER,
    WHITE,
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
    likely,
    occasional,
    one_size,
    post,
    shade,
)

_RIM_M = 0.06
_COUNTER_M = 0.85
_MACHINE_M = 0.85
_PANEL = shade(STEEL, 0.8)


def toilet(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a close-coupled toilet: foot, bowl, seat, lid, cistern and button (EN 997)."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    tank = -y + 0.18
    bowl = y - x  # the middle of the bowl's round end
    return (
        block("foot", (-x + 0.1, x - 0.1), (tank - 0.08, bowl + 0.08), (0.0, 0.2), PORCELAIN),
        block("neck", (-x + 0.06, x - 0.06), (tank - 0.08, bowl - x), (0.2, 0.4), PORCELAIN),
        post("bowl", (0.0, bowl), x, (0.2, 0.4), PORCELAIN),
        post("seat", (0.0, bowl), x - 0.01, (0.4, 0.42), shade(WHITE, 0.93)),
        post("water", (0.0, bowl + 0.01), x - 0.08, (0.42, 0.43), WATER),
        block("cistern", (-x, x), (-y, tank), (0.4, height - 0.02), PORCELAIN),
        block("lid", (-x, x), (-y, tank), (height - 0.02, height), shade(WHITE, 0.97)),
    )


def bath(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a bath: four walls around the water, and a tap at its end (EN 232: 1.7 x 0.7 or 0.75 m)."""
    width, depth, height = size
    x, y, rim = width / 2, depth / 2, height - 0.18
    return (
        block("wall_back", (-x, x), (-y, -y + _RIM_M), (0.0, rim), PORCELAIN),
        block("wall_front", (-x, x), (y - _RIM_M, y), (0.0, rim), PORCELAIN),
        block("wall_left", (-x, -x + 0.12), (-y + _RIM_M, y - _RIM_M), (0.0, rim), PORCELAIN),
        block("wall_right", (x - _RIM_M, x), (-y + _RIM_M, y - _RIM_M), (0.0, rim), PORCELAIN),
        block("water", (-x + 0.12, x - _RIM_M), (-y + _RIM_M, y - _RIM_M), (0.0, rim - 0.16), WATER),
        post("tap", (-x + 0.06, 0.0), 0.02, (rim, height), STEEL),
        block("spout", (-x + 0.08, -x + 0.2), (-0.015, 0.015), (height - 0.05, height - 0.02), STEEL),
    )


def shower(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a corner shower: walls behind it and on its left, glass on its right and half of its front."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    tray = 0.06
    return (
        block("tray", (-x, x), (-y, y), (0.0, tray), WHITE),
        post("drain", (0.0, 0.0), 0.05, (tray, tray + 0.01), DARK),
        block("pane_right", (x - 0.02, x - 0.01), (-y, y - 0.03), (tray, height), GLASS),
        block("pane_front", (-x, -x + 0.45 * width), (y - 0.02, y - 0.01), (tray, height), GLASS),
        block("frame_right", (x - 0.03, x), (y - 0.03, y), (tray, height), STEEL),
        block("frame_front", (-x + 0.45 * width, -x + 0.45 * width + 0.03), (y - 0.03, y), (tray, height), STEEL),
        post("pipe", (0.0, -y + 0.04), 0.015, (0.9, height), STEEL),
        block("arm", (-0.015, 0.015), (-y + 0.055, -y + 0.22), (height - 0.03, height), STEEL),
        post("head", (0.0, -y + 0.22), 0.1, (height - 0.06, height - 0.03), STEEL),
    )


def vanity(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a washbasin on a cabinet under a mirror; a wide one has two basins."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    under = _COUNTER_M - 0.13
    basins = (-width / 4, width / 4) if width >= 1.2 else (0.0,)
    tops = [part for n, at in enumerate(basins, start=1) for part in _basin(n, at, min(0.2, y - 0.08), y)]
    return (
        block("plinth", (-x + 0.02, x - 0.02), (-y, y - 0.08), (0.0, 0.12), DARK),
        block("body", (-x, x), (-y, y - 0.03), (0.12, under), shade(FRONT, 0.6)),
        *fronts(2, 1, (-x, x), (0.12, under), y - 0.01, name="door"),
        block("counter", (-x, x), (-y, y), (under, under + 0.03), WORKTOP),
        *tops,
        block("mirror", (-x + 0.05, x - 0.05), (-y, -y + 0.02), (1.1, height), GLASS),
    )


def _basin(number: int, at: float, radius: float, y: float) -> tuple[Primitive, ...]:
    """Returns a bowl that stands on the counter, the water in it, and its tap."""
    top = _COUNTER_M - 0.1
    return (
        post(f"bowl_{number}", (at, 0.02), radius, (top, _COUNTER_M), PORCELAIN),
        post(f"water_{number}", (at, 0.02), radius - 0.04, (_COUNTER_M, _COUNTER_M + 0.01), WATER),
        block(f"tap_{number}", (at - 0.015, at + 0.015), (-y + 0.02, -y + 0.05), (top, _COUNTER_M + 0.15), STEEL),
    )


def washing_machine(size: Size, _style: Style) -> tuple[Primitive, ...]:
    """Returns a washing machine, with a dryer on top of it when it is tall."""
    width, depth, height = size
    machines = (("washer", 0.0), ("dryer", _MACHINE_M)) if height > _MACHINE_M else (("washer", 0.0),)
    x, y = width / 2, depth / 2
    return tuple(
        part
        for name, z in machines
        for part in (
            block(f"{name}_body", (-x, x), (-y, y - 0.04), (z, z + _MACHINE_M), WHITE),
            block(f"{name}_panel", (-x + 0.02, x - 0.02), (y - 0.04, y - 0.03), (z + 0.73, z + 0.83), _PANEL),
            *_porthole(name, y, z + 0.42),
        )
    )  # fmt: skip


def _porthole(name: str, y: float, z: float) -> tuple[Primitive, ...]:
    """Returns the round glass of a machine as three bars on a ring: an upright face has no round primitive."""
    bars = ((0.1, -0.16, -0.08), (0.16, -0.08, 0.08), (0.1, 0.08, 0.16))
    return (
        block(f"{name}_ring", (-0.19, 0.19), (y - 0.04, y - 0.02), (z - 0.19, z + 0.19), STEEL),
        *(
            block(f"{name}_glass_{n}", (-half, half), (y - 0.02, y), (z + low, z + high), SCREEN)
            for n, (half, low, high) in enumerate(bars, start=1)
        ),
    )


TYPES = (
    FurnitureType(
        "Toilets",
        toilet,
        one_size((0.4, 0.4), (0.7, 0.7), (0.8, 0.8)),
        use_width_m=0.85,
        spread_m2=9.0,
        taste=Taste(corner=0.5, away=0.4, near=("Showers", "Baths", "Toilets")),
        rooms=(
            essential("Bathroom", 1),
            occasional("Bathroom", 14.0, 3),
        ),
    ),
    FurnitureType(
        "VanityCounters",
        vanity,
        (
            Variant((0.6, 0.8), (0.45, 0.5), (1.8, 1.9)),
            Variant((0.9, 1.1), (0.5, 0.55), (1.8, 1.9), (8.0, 1e9)),
            Variant((1.2, 1.6), (0.5, 0.55), (1.8, 1.9), (12.0, 1e9)),
            Variant((1.8, 2.2), (0.55, 0.6), (1.8, 1.9), HALLS),
        ),
        front_m=0.75,
        row=True,
        taste=Taste(corner=0.2, near=("Toilets", "VanityCounters")),
        rooms=(
            essential("Bathroom", 2),
            occasional("Bathroom", 9.0, 2),
        ),
    ),
    FurnitureType(
        "Showers",
        shower,
        (
            Variant((0.8, 0.9), (0.8, 0.9), (2.0, 2.1)),
            Variant((1.0, 1.2), (0.9, 0.9), (2.0, 2.1), (9.0, 1e9)),
        ),
        front_m=0.7,
        anchor="corner",
        row=True,
        spread_m2=10.0,
        taste=Taste(corner=1.0, away=0.4),
        rooms=(
            essential("Bathroom", 3),
            likely("Bathroom", 14.0, 2),
        ),
    ),
    FurnitureType(
        "Baths",
        bath,
        one_size((1.6, 1.8), (0.7, 0.8), (0.75, 0.75)),
        front_m=0.7,
        anchor="corner",
        under_window=True,
        spread_m2=14.0,
        taste=Taste(corner=1.0, window=0.3, away=0.4),
        rooms=(
            essential("Bathroom", 3),
            likely("Bathroom", 18.0, 1),
        ),
    ),
    FurnitureType(
        "WashingMachinesAndDryers",
        washing_machine,
        (Variant((0.6, 0.6), (0.6, 0.6), (0.85, 0.85)), Variant((0.6, 0.6), (0.6, 0.6), (1.7, 1.7))),
        front_m=0.8,
        row=True,
        spread_m2=6.0,
        group="laundry",
        rooms=(
            likely("Bathroom", 9.0, 3),
            occasional("Kitchen", 18.0, 2),
            occasional("Closet", 12.0, 3),
        ),
    ),
)
