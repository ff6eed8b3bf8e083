"""What each of the 31 types is made of: 3 to 14 primitives, enough to be known for what it is and to a lidar."""

from functools import lru_cache

from tasks.worlds.furniture.bathroom import bath, shower, toilet, vanity, washing_machine
from tasks.worlds.furniture.bedroom import bed, floor_lamp
from tasks.worlds.furniture.cabinets import (
    bar_cabinet,
    bookcase,
    chest,
    corner_cabinet,
    media_unit,
    nightstand,
    sideboard,
    storage,
)
from tasks.worlds.furniture.kitchen import dishwasher, fridge, island, oven
from tasks.worlds.furniture.primitives import Composition, Part, Size, Style
from tasks.worlds.furniture.seating import armchair, desk_chair, dining_chair, ottoman, sofa, storage_bench
from tasks.worlds.furniture.tables import coffee_table, console_table, desk, dining_table, serving_cart, side_table

COMPOSITIONS: dict[str, Composition] = {
    "Baths": bath,
    "BarCabinets": bar_cabinet,
    "Beds": bed,
    "Bookcases": bookcase,
    "CoffeeTables": coffee_table,
    "ConsoleTables": console_table,
    "CornerCabinets": corner_cabinet,
    "DeskChairs": desk_chair,
    "Desks": desk,
    "DiningChairs": dining_chair,
    "DiningTables": dining_table,
    "DishWashers": dishwasher,
    "Dressers": chest,
    "EndAndSideTables": side_table,
    "FloorLamps": floor_lamp,
    "Fridges": fridge,
    "KitchenIslandsAndCarts": island,
    "LivingRoomChairs": armchair,
    "MediaStorage": media_unit,
    "Nightstands": nightstand,
    "Ottomans": ottoman,
    "Ovens": oven,
    "ServingCarts": serving_cart,
    "Showers": shower,
    "SideboardsAndBuffets": sideboard,
    "Sofas": sofa,
    "Storage": storage,
    "StorageBenches": storage_bench,
    "Toilets": toilet,
    "VanityCounters": vanity,
    "WashingMachinesAndDryers": washing_machine,
}


@lru_cache(maxsize=4096)
def compose(kind: str, size: Size, style: Style) -> tuple[Part, ...]:
    """Returns the primitives of a piece, in its own frame; homes share sizes, so most have been made before."""
    return COMPOSITIONS[kind](size, style)
