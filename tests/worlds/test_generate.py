"""Worlds keep what is guaranteed, for any valid template."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.data.world import World, solids
from specs.template.body import TemplateBody, template_digest
from tasks.storage.worlds import encode_world
from tasks.worlds.floorplan.floorplan import plan_floor
from tasks.worlds.generate import generate_world
from tasks.worlds.geometry import CELL_M
from tests.worlds.geometry_checks import (
    HEAD_M,
    bottom_m,
    distance_to_start,
    distances,
    in_the_way,
    intersecting,
    polygon,
    room_of,
    top_m,
    unreached_rooms,
    with_doors_open,
)
from tests.worlds.templates import SAMPLES, connection, furniture, materials, room, sample, template, templates

# What the certificate can miss of a radius: a cell, the rest of a centimetre, and what this flood's own places miss. A
# robot that is larger by more does not pass.
GRID_MISSES_M = CELL_M + 0.01 + 0.002
# This flood's robots stand at places 4 cm apart: half a diagonal from where one just passes.
FLOOD_MISSES_M = 0.029
seeds = st.integers(0, 2**32)
any_template = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def make(body: TemplateBody, seed: int = 7, floorplan: int = 1, interior: int = 1, generation: str = "wgj-1") -> World:
    return generate_world(body, seed=seed, generation=generation, floorplan_index=floorplan, interior_index=interior)


@any_template
@given(templates(), seeds)
def test_no_piece_of_furniture_intersects_another_or_a_wall(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    assert intersecting(world) == []
    assert world.certificate.overlaps == 0


@any_template
@given(templates(), seeds)
def test_a_metre_around_the_start_is_clear(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    assert distance_to_start(world) >= 1.0
    assert world.certificate.origin_clear_radius_m == pytest.approx(distance_to_start(world), abs=1e-5)


@pytest.mark.long
@any_template
@given(templates(), seeds)
def test_a_flood_fill_reaches_every_room_with_the_certified_radius(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    assert world.certificate.reachable_robot_radius_m >= 0.25
    certified = world.certificate.reachable_robot_radius_m
    assert unreached_rooms(with_doors_open(world), certified - FLOOD_MISSES_M) == []
    assert certified == 1.0 or unreached_rooms(with_doors_open(world), certified + GRID_MISSES_M) != []


@pytest.mark.long
@any_template
@given(templates(), seeds)
def test_a_flood_fill_agrees_with_what_the_doors_let_pass(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    passing = world.certificate.doors_as_set_robot_radius_m
    assert passing <= FLOOD_MISSES_M or unreached_rooms(world, passing - FLOOD_MISSES_M) == []
    assert passing == 1.0 or unreached_rooms(world, passing + GRID_MISSES_M) != []


@any_template
@given(templates(), seeds)
def test_walls_end_exactly_at_the_ceiling(body: TemplateBody, seed: int) -> None:
    height = body.Buildings[0].Floors[0].Floorplan.Ceiling.Height
    world = make(body, seed)
    assert world.ceiling_height_m == height
    assert {round(top_m(wall), 5) for wall in world.walls} == {round(height, 5)}
    assert {bottom_m(wall) for wall in world.walls if not wall.name.startswith("lintel")} == {0.0}


@any_template
@given(templates(), seeds)
def test_rooms_keep_their_names_types_and_areas(body: TemplateBody, seed: int) -> None:
    wished = body.Buildings[0].Floors[0].Floorplan.Rooms
    world = make(body, seed)
    assert [(each.name, each.type) for each in world.rooms] == [(each.Name, each.Type) for each in wished]
    for found, wish in zip(world.rooms, wished, strict=True):
        floor = found.floor
        area = (floor.x_max_m - floor.x_min_m) * (floor.y_max_m - floor.y_min_m)
        assert area == pytest.approx(wish.DesiredShape.Area, rel=0.03)


@any_template
@given(templates(), seeds)
def test_furniture_stands_in_its_room_below_the_ceiling(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    for piece in world.furniture:
        floor = room_of(world, piece)
        for solid in piece.solids:
            corners = polygon(solid)
            assert (corners >= [floor["x_min_m"] - 1e-5, floor["y_min_m"] - 1e-5]).all()
            assert (corners <= [floor["x_max_m"] + 1e-5, floor["y_max_m"] + 1e-5]).all()
            assert bottom_m(solid) >= -1e-6
            assert top_m(solid) < world.ceiling_height_m


@any_template
@given(templates(), seeds)
def test_passages_are_gaps_with_nothing_in_front_of_them(body: TemplateBody, seed: int) -> None:
    world = make(body, seed).model_copy(update={"doors": ()})
    for passage in world.passages:
        spread = passage.width_m / 2 - 0.4
        along, across = np.meshgrid(np.linspace(-spread, spread, 9), np.linspace(-0.4, 0.4, 9))
        aside = np.stack([along, across] if passage.along == "x" else [across, along], axis=-1)
        way = np.array(passage.center_m) + aside.reshape(-1, 2)
        assert min(float(distances(solid, way).min()) for solid in in_the_way(world)) >= 0.4 - 1e-5
        assert passage.width_m >= 0.9


@any_template
@given(templates(), seeds)
def test_names_of_solids_are_unique(body: TemplateBody, seed: int) -> None:
    world = make(body, seed)
    assert max(Counter(solid.name for solid in solids(world)).values()) == 1


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.name.removesuffix(".body.json"))
def test_every_sample_template_gives_worlds_for_any_seed(path: Path) -> None:
    body = sample(path.name.removesuffix(".body.json"))
    for seed in range(5):
        world = make(body, seed)
        assert world.certificate.area_error_mean < 0.01
        assert unreached_rooms(world, 0.25) == []
        assert world.template_digest == template_digest(body)


def test_the_same_seed_and_indices_give_the_same_bytes() -> None:
    body = sample("task-06-same-flooring")
    first = encode_world(make(body, 5, 2, 3))
    plan_floor.cache_clear()
    assert encode_world(make(body, 5, 2, 3)) == first


@pytest.mark.long
def test_another_process_generates_the_same_bytes() -> None:
    program = (
        "import hashlib; from tests.worlds.templates import sample; from tests.worlds.test_generate import make;"
        "from tasks.storage.worlds import encode_world;"
        "print(hashlib.sha256(encode_world(make(sample('two-rooms')))).hexdigest())"
    )
    digests = {
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    assert len(digests) == 1


@pytest.mark.parametrize(("seed", "floorplan", "interior"), [(8, 1, 1), (7, 2, 1), (7, 1, 2)])
def test_another_seed_or_index_gives_another_world(seed: int, floorplan: int, interior: int) -> None:
    body = sample("two-rooms")
    first, other = make(body), make(body, seed, floorplan, interior)
    assert (first.walls, first.furniture) != (other.walls, other.furniture)


def test_interiors_of_a_floor_plan_share_rooms_and_passages() -> None:
    body = sample("task-06-same-flooring")
    first, second = make(body, interior=1), make(body, interior=2)
    assert [each.floor for each in first.rooms] == [each.floor for each in second.rooms]
    assert first.passages == second.passages
    assert [wall.center_m for wall in first.walls] == [wall.center_m for wall in second.walls]
    assert first.furniture != second.furniture


def test_the_generation_is_written_down_and_changes_nothing_else() -> None:
    body = sample("two-rooms")
    first, second = make(body, generation="wgj-a"), make(body, generation="wgj-b")
    assert second.generation == "wgj-b"
    assert second.model_copy(update={"generation": "wgj-a"}) == first


def test_an_empty_list_of_models_leaves_the_room_empty() -> None:
    world = make(sample("task-10-no-furniture"))
    assert {piece.room for piece in world.furniture} == {"My Living Room"}


def test_a_room_by_name_is_furnished_from_its_own_list() -> None:
    body = template(
        room("Den", "Bedroom"),
        room("Guest", "Bedroom"),
        arrangements=(
            furniture({"RoomTypes": ["Bedroom"]}, ["Beds"]),
            furniture({"RoomNames": ["Den"]}, ["Sofas", "Bookcases"]),
        ),
    )
    world = make(body)
    types = {name: {piece.model_type for piece in world.furniture if piece.room == name} for name in ("Den", "Guest")}
    assert types["Den"] <= {"Sofas", "Bookcases"}
    assert types["Guest"] == {"Beds"}


def test_materials_follow_the_template_by_name_before_type() -> None:
    body = template(
        room("A", "Kitchen"),
        room("B", "Kitchen"),
        flooring=(materials({"RoomTypes": ["Kitchen"]}, "tiles"), materials({"RoomNames": ["B"]}, "floor boards")),
        walls=(materials({"RoomNames": ["A"]}, "WoodPanels"),),
    )
    world = make(body)
    assert [each.flooring.material for each in world.rooms] == ["Tiles", "Floorboards"]
    assert world.rooms[0].walls.material == "Wood panels"


@pytest.mark.parametrize("kind", ["Doorway", "Opening"])
def test_a_wished_connection_of_two_rooms_is_built(kind: str) -> None:
    body = template(room("A"), room("B", "Bedroom"), connections=(connection("B", "A", kind),))
    for seed in range(10):
        world = make(body, seed)
        assert [(each.kind, each.desired, set(each.rooms)) for each in world.passages] == [(kind, True, {"A", "B"})]


def test_several_doorways_of_a_pair_are_built_apart() -> None:
    body = template(room("A"), room("B"), connections=(connection("A", "B"), connection("A", "B")))
    world = make(body)
    assert [each.kind for each in world.passages] == ["Doorway", "Doorway"]
    apart = np.abs(np.subtract(world.passages[0].center_m, world.passages[1].center_m)).max()
    assert apart >= 0.9


def test_a_hall_is_joined_to_all_rooms_that_wish_it() -> None:
    names = ("Bedroom", "Bath", "Kitchen", "Study")
    rooms = [room(name, area_m2=15.0) for name in names]
    wishes = tuple(connection("Hall", name) for name in names)
    body = template(room("Hall", "Hallway", 16.0, (3.0, 1.0)), *rooms, connections=wishes)
    for seed in range(5):
        wished = {frozenset(each.rooms) for each in make(body, seed).passages if each.desired}
        assert wished == {frozenset(("Hall", name)) for name in names}


def test_rooms_without_wishes_are_joined_by_doorways_that_nobody_wished() -> None:
    world = make(sample("task-06-same-flooring"))
    assert len(world.passages) == len(world.rooms) - 1
    assert not any(each.desired for each in world.passages)


def test_a_narrow_hallway_alone_is_widened_for_the_start_and_says_so() -> None:
    world = make(template(room("Hall", "Hallway", 10.0, (4.0, 1.0))))
    floor = world.rooms[0].floor
    assert floor.y_max_m - floor.y_min_m >= 2.1
    assert any("Hall" in sentence and "4:1" in sentence for sentence in world.certificate.unmet)


def test_a_footprint_wish_shapes_a_room_that_wishes_nothing() -> None:
    outline = make(sample("task-04-wide-footprint")).footprint
    aspect = (outline.y_max_m - outline.y_min_m) / (outline.x_max_m - outline.x_min_m)
    assert aspect > 2.5


def test_a_six_room_flat_stays_within_its_solids() -> None:
    rooms = [
        room(f"R{n}", kind) for n, kind in enumerate(("Living", "Kitchen", "Dining", "Bedroom", "Bathroom", "Closet"))
    ]
    for seed in range(3):
        assert len(solids(make(template(*rooms), seed))) <= 480


def test_lintels_hang_above_heads() -> None:
    world = make(sample("two-rooms"))
    lintels = [wall for wall in world.walls if wall.name.startswith("lintel")]
    assert len(lintels) == sum(each.kind == "Doorway" for each in world.passages)
    assert all(bottom_m(lintel) >= HEAD_M for lintel in lintels)
