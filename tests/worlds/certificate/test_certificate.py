"""The certificate says what is there, also of a world that somebody spoiled."""

import pytest

from specs.data.world import Certificate, Furniture, Solid, World
from tasks.worlds.certificate import broken_guarantees, certify, survey
from tasks.worlds.generate import generate_world
from tasks.worlds.geometry import Box, reaches_room
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.templates import room, template

BODY = template(room("A", area_m2=20.0), room("B", area_m2=20.0))
BRIEF = resolve_template(BODY)


def world() -> World:
    return generate_world(BODY, seed=3, generation="wgj-1", floorplan_index=1, interior_index=1)


def certificate(made: World, *more: Solid, brief: ResolvedTemplate = BRIEF) -> Certificate:
    extra = [
        Furniture(name=each.name, model_type="Ottomans", room="A", center_m=(0.0, 0.0), yaw_rad=0.0, solids=(each,))
        for each in more
    ]
    return certify(
        brief, made.rooms, made.passages, walls=made.walls, furniture=(*made.furniture, *extra), doors=made.doors
    )


def post(x: float, y: float, radius: float, bottom: float = 0.0) -> Solid:
    return Solid(
        name=f"post {x} {y}",
        shape="cylinder",
        center_m=(x, y, bottom + 0.2),
        half_extents_m=(radius, radius, 0.2),
        yaw_rad=0.0,
        color=(0.0, 0.0, 0.0),
    )


def test_measuring_a_world_again_gives_its_certificate() -> None:
    made = world()
    assert certificate(made) == made.certificate
    assert broken_guarantees(made.certificate) == ()


def test_a_post_near_the_start_breaks_the_clear_metre() -> None:
    found = certificate(world(), post(0.3, 0.4, 0.1))
    assert found.origin_clear_radius_m == pytest.approx(0.4)
    assert "0.4 m around the start" in broken_guarantees(found)[0]


def test_what_hangs_above_heads_is_not_in_the_way() -> None:
    made = world()
    assert certificate(made, post(0.0, 0.0, 0.5, bottom=2.2)).origin_clear_radius_m > 1.0


def test_a_blocked_doorway_shuts_a_room_off() -> None:
    made = world()
    found = certificate(made, post(*made.passages[0].center_m, 0.3))
    assert found.reachable_robot_radius_m < 0.25
    assert any("does not reach every room" in sentence for sentence in broken_guarantees(found))


def test_a_piece_in_a_wall_is_an_overlap() -> None:
    made = world()
    x, y, _ = made.walls[0].center_m
    found = certificate(made, post(x, y, 0.2))
    assert found.overlaps >= 1
    assert any("overlap" in sentence for sentence in broken_guarantees(found))


def test_the_radius_never_exceeds_half_the_narrowest_passage() -> None:
    found = world().certificate
    assert found.narrowest_passage_m == 0.9
    assert 0.3 < found.reachable_robot_radius_m <= 0.45


@pytest.mark.parametrize("offset_m", [0.0, 0.1, 0.2, 0.35, 0.6])
def test_the_radius_is_the_largest_that_reaches_every_room(offset_m: float) -> None:
    made = world()
    x, y, _ = (*made.passages[0].center_m, 0.0)
    aside = (x + offset_m, y) if made.passages[0].along == "x" else (x, y + offset_m)
    blocked = Furniture(
        name="post", model_type="Ottomans", room="A", center_m=aside, yaw_rad=0.0, solids=(post(*aside, 0.05),)
    )
    furniture = (*made.furniture, blocked)
    clear = survey(made.rooms, made.passages, made.walls, furniture, made.doors).opened
    floors = [Box(*room.floor.model_dump().values()) for room in made.rooms]
    radii = [step / 100 for step in range(1, 101)]
    reached = [all(reaches_room(clear.reached(r), clear, floor, r) for floor in floors) for r in radii]
    largest = max((radius for radius, found in zip(radii, reached, strict=True) if found), default=0.0)
    assert certificate(made, post(*aside, 0.05)).reachable_robot_radius_m == pytest.approx(largest)


def test_missed_areas_and_aspects_are_named_with_numbers() -> None:
    other = resolve_template(template(room("A", area_m2=25.0), room("B", area_m2=20.0, aspect=(4.0, 1.0))))
    found = certificate(world(), brief=other)
    assert found.area_error_mean == pytest.approx(0.1, abs=0.01)
    assert any(sentence.startswith("A: 20.0 m2, wished 25 m2") for sentence in found.unmet)
    assert any(sentence.startswith("B: ") and "wished 4:1" in sentence for sentence in found.unmet)


def test_free_floor_is_what_furniture_leaves() -> None:
    made = world()
    less = certificate(made, post(0.0, 0.0, 0.5)).free_floor_share
    assert made.certificate.free_floor_share - less == pytest.approx(1.0 / 40.0, rel=0.1)
