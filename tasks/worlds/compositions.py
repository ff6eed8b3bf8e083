"""What each type of furniture is made of; few primitives each, enough to be recognised and to be seen by a lidar."""

from tasks.worlds.parts import Composition, Part, Size, Tints, block, legs, post

_WHITE = (0.95, 0.95, 0.94)
_STEEL = (0.74, 0.76, 0.78)
_DARK = (0.16, 0.16, 0.18)
_WATER = (0.72, 0.85, 0.9)
_PANE = (0.78, 0.88, 0.92)


def _table(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    top = block("top", (-width / 2, width / 2), (-depth / 2, depth / 2), (height - 0.04, height), tints.body)
    return (top, *legs(width, depth, height - 0.04, 0.06, tints.body))


def _panel_table(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("top", (-x, x), (-y, y), (height - 0.04, height), tints.body),
        block("side_left", (-x + 0.04, -x + 0.08), (-y + 0.03, y - 0.03), (0.0, height - 0.04), tints.accent),
        block("side_right", (x - 0.08, x - 0.04), (-y + 0.03, y - 0.03), (0.0, height - 0.04), tints.accent),
    )


def _desk(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("top", (-x, x), (-y, y), (height - 0.04, height), tints.body),
        block("drawers", (x - 0.42, x - 0.03), (-y + 0.03, y - 0.05), (0.0, height - 0.04), tints.accent),
        block("side", (-x + 0.03, -x + 0.07), (-y + 0.03, y - 0.05), (0.0, height - 0.04), tints.body),
        block("screen", (-0.3, 0.3), (-y + 0.08, -y + 0.11), (height, height + 0.4), _DARK),
    )


def _bed(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("headboard", (-x, x), (-y, -y + 0.06), (0.0, height + 0.5), tints.body),
        block("frame", (-x, x), (-y + 0.06, y), (0.0, height - 0.2), tints.body),
        block("mattress", (-x + 0.03, x - 0.03), (-y + 0.06, y - 0.03), (height - 0.2, height), tints.fabric),
        block("pillows", (-x + 0.15, x - 0.15), (-y + 0.1, -y + 0.5), (height, height + 0.1), _WHITE),
    )


def _sofa(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y, arm = width / 2, depth / 2, 0.16
    return (
        block("seat", (-x + arm, x - arm), (-y + 0.2, y), (0.0, 0.44), tints.fabric),
        block("back", (-x + arm, x - arm), (-y, -y + 0.2), (0.0, height), tints.fabric),
        block("arm_left", (-x, -x + arm), (-y, y), (0.0, 0.62), tints.fabric),
        block("arm_right", (x - arm, x), (-y, y), (0.0, 0.62), tints.fabric),
    )


def _chair(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("back", (-x, x), (-y, -y + 0.04), (0.0, height), tints.body),
        block("seat", (-x, x), (-y + 0.04, y), (0.43, 0.47), tints.fabric),
        block("leg_left", (-x, -x + 0.04), (y - 0.04, y), (0.0, 0.43), tints.body),
        block("leg_right", (x - 0.04, x), (y - 0.04, y), (0.0, 0.43), tints.body),
    )


def _desk_chair(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        post("base", (0.0, 0.0), min(x, y) * 0.95, (0.0, 0.06), _DARK),
        post("column", (0.0, 0.0), 0.04, (0.06, 0.43), _STEEL),
        block("seat", (-x + 0.03, x - 0.03), (-y + 0.06, y), (0.43, 0.51), tints.fabric),
        block("back", (-x + 0.05, x - 0.05), (-y, -y + 0.06), (0.51, height), tints.fabric),
    )


def _shelves(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("back", (-x, x), (-y, -y + 0.03), (0.0, height), tints.accent),
        block("side_left", (-x, -x + 0.03), (-y + 0.03, y), (0.0, height), tints.body),
        block("side_right", (x - 0.03, x), (-y + 0.03, y), (0.0, height), tints.body),
        block("books_low", (-x + 0.03, x - 0.03), (-y + 0.03, y - 0.03), (0.08, 0.38), tints.fabric),
        block("books_high", (-x + 0.03, x - 0.03), (-y + 0.03, y - 0.06), (1.0, 1.3), tints.fabric),
    )


def _cabinet(size: Size, tints: Tints) -> tuple[Part, ...]:
    """A body with a front: wardrobes, dressers, sideboards, nightstands."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x, x), (-y, y - 0.02), (0.0, height), tints.body),
        block("front", (-x + 0.04, x - 0.04), (y - 0.02, y), (0.08, height - 0.05), tints.accent),
    )


def _counter(size: Size, tints: Tints) -> tuple[Part, ...]:
    """A body with a slab on top: islands, bars."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x + 0.05, x - 0.05), (-y + 0.05, y - 0.05), (0.0, height - 0.04), tints.body),
        block("slab", (-x, x), (-y, y), (height - 0.04, height), tints.accent),
    )


def _media(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, height = size[0], size[2]
    x = min(width / 2 - 0.1, 0.6)
    screen = block("screen", (-x, x), (-0.03, 0.03), (height + 0.05, height + 0.75), _DARK)
    foot = block("foot", (-0.15, 0.15), (-0.08, 0.08), (height, height + 0.05), _DARK)
    return (*_cabinet(size, tints), foot, screen)


def _lamp(size: Size, tints: Tints) -> tuple[Part, ...]:
    radius, height = min(size[0], size[1]) / 2, size[2]
    return (
        post("base", (0.0, 0.0), radius * 0.8, (0.0, 0.03), _DARK),
        post("pole", (0.0, 0.0), 0.02, (0.03, height - 0.3), _DARK),
        post("shade", (0.0, 0.0), radius, (height - 0.3, height), tints.fabric),
    )


def _round_table(size: Size, tints: Tints) -> tuple[Part, ...]:
    radius, height = min(size[0], size[1]) / 2, size[2]
    return (
        post("foot", (0.0, 0.0), radius * 0.6, (0.0, 0.03), tints.accent),
        post("column", (0.0, 0.0), 0.04, (0.03, height - 0.03), tints.accent),
        post("top", (0.0, 0.0), radius, (height - 0.03, height), tints.body),
    )


def _ottoman(size: Size, tints: Tints) -> tuple[Part, ...]:
    return (post("seat", (0.0, 0.0), min(size[0], size[1]) / 2, (0.0, size[2]), tints.fabric),)


def _bench(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("chest", (-x, x), (-y, y), (0.0, height - 0.08), tints.body),
        block("cushion", (-x + 0.02, x - 0.02), (-y + 0.02, y - 0.02), (height - 0.08, height), tints.fabric),
    )


def _cart(size: Size, tints: Tints) -> tuple[Part, ...]:
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("end_left", (-x, -x + 0.04), (-y, y), (0.0, height), tints.accent),
        block("end_right", (x - 0.04, x), (-y, y), (0.0, height), tints.accent),
        block("shelf_low", (-x + 0.04, x - 0.04), (-y, y), (0.2, 0.24), tints.body),
        block("shelf_high", (-x + 0.04, x - 0.04), (-y, y), (height - 0.12, height - 0.08), tints.body),
    )


def _fridge(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints  # appliances are white and steel whatever the room
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x, x), (-y, y - 0.06), (0.0, height), _STEEL),
        block("freezer_door", (-x, x), (y - 0.06, y - 0.02), (0.05, height * 0.36), _WHITE),
        block("door", (-x, x), (y - 0.06, y - 0.02), (height * 0.37, height), _WHITE),
        block("handle", (-x + 0.05, -x + 0.08), (y - 0.02, y), (height * 0.45, height * 0.75), _DARK),
    )


def _oven(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x, x), (-y, y - 0.03), (0.0, height - 0.02), _STEEL),
        block("hob", (-x + 0.02, x - 0.02), (-y + 0.04, y - 0.05), (height - 0.02, height), _DARK),
        block("window", (-x + 0.06, x - 0.06), (y - 0.03, y), (0.25, 0.65), _DARK),
    )


def _appliance(size: Size, tints: Tints) -> tuple[Part, ...]:
    """A dishwasher under its piece of worktop."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x, x), (-y, y - 0.03), (0.0, height - 0.04), _WHITE),
        block("front", (-x + 0.02, x - 0.02), (y - 0.03, y), (0.1, height - 0.06), _STEEL),
        block("worktop", (-x, x), (-y, y - 0.01), (height - 0.04, height), tints.accent),
    )


def _washer(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("body", (-x, x), (-y, y - 0.03), (0.0, height), _WHITE),
        block("porthole", (-0.17, 0.17), (y - 0.03, y), (0.25, 0.6), _DARK),
    )


def _toilet(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("tank", (-x, x), (-y, -y + 0.18), (0.35, height), _WHITE),
        block("stem", (-x + 0.08, x - 0.08), (-y, y - 0.25), (0.0, 0.35), _WHITE),
        post("bowl", (0.0, y - x), x, (0.2, 0.42), _WHITE),
    )


def _bath(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("tub", (-x, x), (-y, y), (0.0, height), _WHITE),
        block("water", (-x + 0.08, x - 0.08), (-y + 0.08, y - 0.08), (height, height + 0.005), _WATER),
        block("tap", (x - 0.07, x - 0.02), (-0.05, 0.05), (height, height + 0.15), _STEEL),
    )


def _shower(size: Size, tints: Tints) -> tuple[Part, ...]:
    del tints
    width, depth, height = size
    x, y = width / 2, depth / 2
    return (
        block("tray", (-x, x), (-y, y), (0.0, 0.1), _WHITE),
        block("pane_left", (-x, -x + 0.02), (-y, y), (0.1, height), _PANE),
        block("pane_right", (x - 0.02, x), (-y, y), (0.1, height), _PANE),
        post("pipe", (0.0, -y + 0.06), 0.02, (0.1, height), _STEEL),
    )


def _vanity(size: Size, tints: Tints) -> tuple[Part, ...]:
    height = size[2]
    basin = post("basin", (0.0, 0.02), 0.19, (height, height + 0.1), _WHITE)
    return (*_counter(size, tints), basin)


COMPOSITIONS: dict[str, Composition] = {
    "Baths": _bath,
    "BarCabinets": _counter,
    "Beds": _bed,
    "Bookcases": _shelves,
    "CoffeeTables": _panel_table,
    "ConsoleTables": _panel_table,
    "CornerCabinets": _cabinet,
    "DeskChairs": _desk_chair,
    "Desks": _desk,
    "DiningChairs": _chair,
    "DiningTables": _table,
    "DishWashers": _appliance,
    "Dressers": _cabinet,
    "EndAndSideTables": _round_table,
    "FloorLamps": _lamp,
    "Fridges": _fridge,
    "LivingRoomChairs": _sofa,
    "KitchenIslandsAndCarts": _counter,
    "MediaStorage": _media,
    "Nightstands": _cabinet,
    "Ottomans": _ottoman,
    "Ovens": _oven,
    "ServingCarts": _cart,
    "Showers": _shower,
    "SideboardsAndBuffets": _cabinet,
    "Sofas": _sofa,
    "Storage": _cabinet,
    "StorageBenches": _bench,
    "Toilets": _toilet,
    "VanityCounters": _vanity,
    "WashingMachinesAndDryers": _washer,
}
