"""Worlds as arrays are kept, and are what they would be anew."""

import numpy as np
import pytest

from specs.data.world import Solid, World
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry import world_arrays
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds
from tests.factories.simulations import cluttered

HULL, SEEN_AT_M = Hull(0.18, 0.02, 0.38), 0.2


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begins each test without a kept stage."""
    monkeypatch.setattr(world_arrays, "_kept", type(world_arrays._kept)())  # pyright: ignore[reportPrivateUsage] - it lives as long as a process
    monkeypatch.setattr(world_arrays, "_most", {})


def staged(world: World, hull: Hull = HULL, seen_at_m: float = SEEN_AT_M) -> WorldArrays:
    return arrays_of_worlds({"w": world}, hull, seen_at_m)["w"]


def test_a_world_is_made_into_arrays_once():
    world = cluttered(1)
    one, again = staged(world), staged(world)
    assert one.floor is again.floor
    assert one.ways is again.ways


def test_another_robot_or_world_of_that_name_has_arrays_of_its_own():
    world = cluttered(1)
    one = staged(world)
    wide, high, other = (
        staged(world, Hull(0.3, 0.02, 0.38)),
        staged(world, HULL._replace(low_m=1.0, high_m=1.5)),
        staged(cluttered(2)),
    )
    assert not np.array_equal(one.rooms.parts, wide.rooms.parts)
    assert not np.array_equal(one.floor.clearance_m, high.floor.clearance_m)
    assert not np.array_equal(one.floor.clearance_m, other.floor.clearance_m)


def test_an_application_cannot_write_to_a_map_that_others_get():
    with pytest.raises(ValueError, match="read-only"):
        staged(cluttered(1)).floor.clearance_m[0, 0] = 1.0


def test_no_more_is_kept_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch):
    worlds = {f"w-{seed}": cluttered(seed) for seed in range(3)}
    monkeypatch.setattr(world_arrays, "_KEPT_BYTES", 0)
    first = arrays_of_worlds(worlds, HULL, SEEN_AT_M)
    assert arrays_of_worlds(worlds, HULL, SEEN_AT_M)["w-0"].floor is first["w-0"].floor  # those of a chunk are all kept
    staged(cluttered(9))
    assert len(world_arrays._kept) == 1  # pyright: ignore[reportPrivateUsage] - see above


def counts(stage: WorldArrays) -> list[int]:
    return [len(array) for array in (*stage.touched, *stage.seen)]


def test_no_worlds_are_no_arrays():
    assert arrays_of_worlds({}, HULL, SEEN_AT_M) == {}


def test_worlds_are_filled_up_like_those_before_that_have_up_to_twice_as_many_solids():
    few = cluttered(1)
    many, most = (few.model_copy(update={"walls": few.walls * (count // len(few.walls))}) for count in (200, 400))
    alone = staged(few)
    assert counts(staged(many))[0] == 2 * counts(alone)[0]
    assert counts(staged(few)) == counts(staged(many))
    assert np.array_equal(staged(few).touched.boxes[: len(alone.touched.boxes)], alone.touched.boxes)
    staged(most)
    assert counts(staged(few)) == counts(alone)
    assert counts(staged(few, Hull(0.3, 0.02, 0.38))) == counts(alone)


def test_a_world_is_filled_up_like_a_larger_one_that_it_once_shared_a_chunk_with():
    small = cluttered(1)
    some, more = (small.model_copy(update={"walls": small.walls * (count // len(small.walls))}) for count in (200, 400))
    together = arrays_of_worlds({"some": some, "more": more}, HULL, SEEN_AT_M)
    assert counts(staged(some)) == counts(together["some"])


def with_walls(low: int, high: int) -> World:
    """Returns a world with walls that a hull touches and no lidar at 1 m sees, and others that it sees alone."""
    base = cluttered(1)
    x, y, _ = base.walls[0].center_m
    half_x, half_y, _ = base.walls[0].half_extents_m

    def walls(count: int, z: float) -> list[Solid]:
        update = {"center_m": (x, y, z), "half_extents_m": (half_x, half_y, 0.05)}
        return [base.walls[0].model_copy(update=update)] * count

    return base.model_copy(update={"walls": (*walls(low, 0.2), *walls(high, 1.0))})


def test_what_worlds_are_filled_up_like_grows_kind_by_kind():
    staged(with_walls(400, 0), seen_at_m=1.0)
    staged(with_walls(0, 800), seen_at_m=1.0)  # of the first kind too few to be filled up like the world before
    boxes, _, upright, *_ = counts(staged(with_walls(200, 600), seen_at_m=1.0))
    assert (boxes, upright) == (512, 1024)
