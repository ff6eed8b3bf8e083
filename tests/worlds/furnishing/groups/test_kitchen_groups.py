"""A kitchen's units stand in one order."""

from tasks.worlds.furnishing.arrangements import ROW


def test_a_row_begins_with_its_tall_end() -> None:
    assert ROW == ("Fridges", "DishWashers", "Ovens", "WashingMachinesAndDryers")
