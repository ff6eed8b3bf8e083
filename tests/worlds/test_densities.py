"""Each density leaves less floor free than the one before, and what is aimed at is what is promised."""

from itertools import pairwise

import pytest

from specs.data.world import RoomType
from specs.template.interior import Density
from tasks.worlds.furnishing.furnish import InteriorKey, furnish_interior
from tasks.worlds.resolved_template import COVERED, COVERED_BY_TYPE, COVERED_SPREAD, FREE_FLOOR
from tests.worlds.rooms import home, walls_of
from tests.worlds.templates import ROOM_TYPES

ORDER: tuple[Density, ...] = ("Sparse", "Moderate", "Dense")
SEEDS = range(1, 5)
AREAS_M2 = (14.0, 30.0)


def free_floor(kind: RoomType, density: Density) -> list[float]:
    found: list[float] = []
    for area in AREAS_M2:
        brief, plan = home(kind, area, density)
        for seed in SEEDS:
            clearance = furnish_interior(brief, plan, walls_of(plan), InteriorKey(seed, 1, 1)).clearance
            found.append(1.0 - float(clearance.covered[clearance.cells(plan.floors[0])].mean()))
    return found


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_what_is_aimed_at_counts_as_met(kind: RoomType) -> None:
    for density in ORDER:
        least, most = FREE_FLOOR[density]
        free = 1.0 - COVERED_BY_TYPE.get(kind, COVERED)[density]
        assert least < free - COVERED_SPREAD
        assert free + COVERED_SPREAD < most


def test_the_bands_follow_each_other() -> None:
    for fuller, emptier in pairwise(FREE_FLOOR[density] for density in reversed(ORDER)):
        assert fuller[0] < emptier[0]
        assert fuller[1] < emptier[1]
        assert fuller[1] - emptier[0] <= 0.06 + 1e-9


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_rooms_of_each_type_tell_the_densities_apart(kind: RoomType) -> None:
    sparse, moderate, dense = (free_floor(kind, density) for density in ORDER)
    assert min(sparse) > max(moderate)
    assert sum(moderate) / len(moderate) > sum(dense) / len(dense) + 0.04
    met = [least <= free <= most for density, rooms in zip(ORDER, (sparse, moderate, dense), strict=True)
           for least, most in [FREE_FLOOR[density]] for free in rooms]  # fmt: skip
    assert sum(met) >= 0.9 * len(met)
