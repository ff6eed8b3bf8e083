"""A floor plan has its start in a room that holds the clear disc."""

from pathlib import Path

import pytest

from tasks.worlds.brief import brief_of
from tasks.worlds.floorplan import plan_floor
from tests.worlds.templates import SAMPLES, room, sample, template


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.name.removesuffix(".body.json"))
def test_walls_keep_off_the_start(path: Path) -> None:
    brief = brief_of(sample(path.name.removesuffix(".body.json")))
    for seed in range(5):
        floors = plan_floor(brief, seed, 1).floors
        assert any(max(floor.x_min, floor.y_min, -floor.x_max, -floor.y_max) <= -1.0 for floor in floors)


def test_the_start_is_in_the_largest_room() -> None:
    brief = brief_of(template(room("Small"), room("Large", area_m2=40.0), room("Middle", area_m2=25.0)))
    for seed in range(5):
        floor = plan_floor(brief, seed, 1).floors[1]
        assert floor.x_min < 0.0 < floor.x_max
        assert floor.y_min < 0.0 < floor.y_max


def test_floor_plans_of_one_job_differ() -> None:
    brief = brief_of(sample("task-06-same-flooring"))
    assert len({plan_floor(brief, 1, index).cells for index in range(1, 6)}) >= 4
