"""Templates that AWS never printed: each gives good worlds that name what they could not do, or a clear refusal."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from pydantic import JsonValue

from specs.data.world import World
from specs.errors import DocumentError
from specs.template.body import TemplateBody
from tasks.documents.parse import parse
from tasks.worlds.generate import generate_world
from tests.worlds.geometry_checks import distance_to_start, intersecting, top_m, unreached_rooms, with_doors_open
from tests.worlds.templates import MODEL_TYPES, connection, doorway, furniture, materials, room, template

pytestmark = pytest.mark.long

SEEDS = range(3)
RADIUS_M = 0.25


def good_world(body: TemplateBody, seed: int = 0, radius_m: float = RADIUS_M) -> World:
    """Returns the first world of a seed, once everything that is guaranteed has been seen on its geometry."""
    world = generate_world(
        body, seed=seed, generation="wgj-1", floorplan_index=1, interior_index=1, robot_radius_m=radius_m
    )
    assert intersecting(world) == []
    assert distance_to_start(world) >= 1.0
    assert unreached_rooms(with_doors_open(world), radius_m) == []
    plan = body.Buildings[0].Floors[0].Floorplan
    assert [each.name for each in world.rooms] == [each.Name for each in plan.Rooms]
    assert [area for _, area in areas(world)] == pytest.approx(
        [each.DesiredShape.Area for each in plan.Rooms], rel=0.03
    )
    assert {round(top_m(wall), 6) for wall in world.walls} == {plan.Ceiling.Height}
    return world


def areas(world: World) -> list[tuple[str, float]]:
    sides = [(each.name, each.floor) for each in world.rooms]
    return [(name, (box.x_max_m - box.x_min_m) * (box.y_max_m - box.y_min_m)) for name, box in sides]


def proportions(world: World) -> list[float]:
    """Returns each room's extent along x over that along y."""
    floors = [each.floor for each in world.rooms]
    return [(box.x_max_m - box.x_min_m) / (box.y_max_m - box.y_min_m) for box in floors]


def unmet(world: World, kind: str) -> list[str]:
    """Returns the subjects of unmet wishes of a kind."""
    return [wish.subject for wish in world.certificate.wishes if wish.kind == kind and not wish.met]


def built(world: World) -> list[frozenset[str]]:
    """Returns the pairs between which a wished way was built."""
    return [frozenset(passage.rooms) for passage in world.passages if passage.desired]


def rooms_named(*names: str, area_m2: float = 20.0) -> list[dict[str, JsonValue]]:
    return [room(name, "Bedroom", area_m2) for name in names]


@pytest.mark.parametrize("seed", SEEDS)
def test_one_square_room_of_10_square_metres_is_square(seed: int) -> None:
    world = good_world(template(room("A", area_m2=10.0)), seed)
    assert proportions(world)[0] == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("aspect", [(4.0, 1.0), (1.0, 4.0)])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_room_too_narrow_for_the_start_is_as_slim_as_may_be_and_says_so(
    aspect: tuple[float, float], seed: int
) -> None:
    # 10 m2 at 4:1 are 1.6 m wide, and the clear metre around the start needs 2 m.
    world = good_world(template(room("A", area_m2=10.0, aspect=aspect), footprint=aspect), seed)
    found = proportions(world)[0]
    slimness = found if aspect[0] > aspect[1] else 1.0 / found
    assert 2.0 < slimness < 2.5
    assert unmet(world, "aspect") == ["A"]


@pytest.mark.parametrize("seed", SEEDS)
def test_six_closets_make_a_home(seed: int) -> None:
    world = good_world(template(*(room(f"Closet {n}", "Closet", 10.0) for n in range(6))), seed)
    assert len(world.passages) == 5
    assert {piece.room for piece in world.furniture} == {each.name for each in world.rooms}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_flat_along_a_4_to_1_hallway_keeps_its_hallway(seed: int) -> None:
    names = ("Bath", "Kitchen", "Bedroom", "Living")
    body = template(
        room("Hall", "Hallway", 16.0, (4.0, 1.0)),
        *rooms_named(*names),
        connections=tuple(connection("Hall", name) for name in names),
        footprint=(2.0, 1.0),
    )
    world = good_world(body, seed)
    assert proportions(world)[0] == pytest.approx(4.0, rel=0.25)
    assert sorted(map(sorted, built(world))) == sorted(sorted(("Hall", name)) for name in names)


@pytest.mark.parametrize("count", [3, 4, 5, 6])
@pytest.mark.parametrize("kind", ["Doorway", "Opening"])
def test_a_ring_of_rooms_closes(count: int, kind: str) -> None:
    names = "ABCDEF"[:count]
    ring = tuple(connection(name, names[(n + 1) % count], kind) for n, name in enumerate(names))
    for seed in SEEDS[:2]:
        world = good_world(template(*rooms_named(*names), connections=ring), seed)
        assert len(built(world)) == count
        assert {passage.kind for passage in world.passages} == {kind}


@pytest.mark.parametrize("seed", SEEDS)
def test_five_rooms_that_all_want_each_other_get_what_rectangles_can_have(seed: int) -> None:
    # Five rectangles that fill a rectangle touch in 3 x 5 - 7 = 8 pairs at most, in a pinwheel; sliced ones in 7.
    pairs = [connection(first, second) for first, second in combinations("ABCDE", 2)]
    world = good_world(template(*rooms_named(*"ABCDE"), connections=tuple(pairs)), seed)
    assert len(built(world)) in {7, 8}
    assert len(unmet(world, "connection")) == 10 - len(built(world))


@pytest.mark.parametrize("seed", SEEDS)
def test_twelve_connections_of_six_rooms_are_met_as_far_as_can_be(seed: int) -> None:
    # Each with each but for three pairs: as many connections as a template may have, four for each room.
    apart = ({"A", "B"}, {"C", "D"}, {"E", "F"})
    pairs = [pair for pair in combinations("ABCDEF", 2) if set(pair) not in apart]
    body = template(*rooms_named(*"ABCDEF"), connections=tuple(connection(*pair) for pair in pairs))
    world = good_world(body, seed)
    assert len(pairs) == 12
    assert len(built(world)) >= 8
    assert len(unmet(world, "connection")) == 12 - len(built(world))
    assert all("none, wished 1 doorway" in sentence for sentence in world.certificate.unmet if " - " in sentence)


@pytest.mark.parametrize("seed", SEEDS)
def test_four_doorways_of_one_pair_stand_side_by_side(seed: int) -> None:
    world = good_world(template(*rooms_named("A", "B"), connections=(connection("A", "B"),) * 4), seed)
    middles = np.array(sorted(passage.center_m for passage in world.passages))
    assert len(middles) == 4
    assert (np.abs(np.diff(middles, axis=0)).sum(axis=1) > 0.95).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bathroom_of_300_square_metres_is_a_bathroom(seed: int) -> None:
    world = good_world(template(room("Bath", "Bathroom", 300.0)), seed)
    assert {"Toilets", "VanityCounters"} <= {piece.model_type for piece in world.furniture}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_closet_beside_a_hall_of_thirty_times_its_size_has_its_own_size(seed: int) -> None:
    body = template(
        room("Hall", "Living", 300.0), room("Closet", "Closet", 10.0), connections=(connection("Hall", "Closet"),)
    )
    world = good_world(body, seed)
    assert len(built(world)) == 1


def test_five_closets_around_a_hall_of_300_square_metres_make_a_home() -> None:
    good_world(template(room("Hall", area_m2=300.0), *(room(f"Closet {n}", "Closet", 10.0) for n in range(5))))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_footprint_against_its_only_room_is_settled_and_named(seed: int) -> None:
    world = good_world(template(room("A", aspect=(1.0, 4.0)), footprint=(4.0, 1.0)), seed)
    assert [*unmet(world, "footprint"), *unmet(world, "aspect")] != []


def test_an_unknown_material_is_kept_and_named_unmet() -> None:
    target: JsonValue = {"RoomNames": ["A"]}
    body = template(room("A"), flooring=(materials(target, "Lava"),), walls=(materials(target, "Lava", "brick"),))
    world = good_world(body)
    assert world.rooms[0].walls.material == "Brick"
    assert [(wish.kind, wish.wished) for wish in world.certificate.wishes if "no such material" in wish.found] == [
        ("flooring", "Lava"),
        ("walls", "Lava"),
    ]


@pytest.mark.parametrize("density", ["Sparse", "Moderate", "Dense"])
def test_an_empty_list_of_furniture_is_an_empty_room_at_any_density(density: str) -> None:
    world = good_world(template(room("A"), arrangements=(furniture({"RoomNames": ["A"]}, [], density),)))
    assert world.furniture == ()
    assert world.certificate.free_floor_share == 1.0
    assert unmet(world, "furniture") + unmet(world, "density") == []


@pytest.mark.parametrize("model", MODEL_TYPES)
def test_a_room_of_one_kind_of_furniture_has_nothing_else(model: str) -> None:
    world = good_world(template(room("A", area_m2=25.0), arrangements=(furniture({"RoomNames": ["A"]}, [model]),)))
    assert {piece.model_type for piece in world.furniture} == {model}


def test_rooms_keep_the_oddest_names_that_are_allowed() -> None:
    names = (" ", "-", "--- x ---", "a" * 255, "A" * 255, "wall_south_1")
    pairs = tuple(connection(first, second) for first, second in pairwise(names))
    world = good_world(template(*rooms_named(*names), connections=pairs))
    assert len(built(world)) == 5
    assert {piece.room for piece in world.furniture} <= set(names)


@pytest.mark.parametrize("radius_m", [0.05, 0.34, 0.45, 0.49, 0.59])
@pytest.mark.parametrize("version", ["1", "2"])
def test_a_robot_of_any_width_gets_into_every_room(version: str, radius_m: float) -> None:
    rooms = [room("Hall", "Hallway", 14.0, (2.0, 1.0)), *rooms_named("A", "B", "C", area_m2=14.0)]
    body = template(*rooms, connections=tuple(connection("Hall", name) for name in "ABC"), version=version)
    world = good_world(body, radius_m=radius_m)
    assert world.certificate.guaranteed_robot_radius_m == radius_m
    assert world.certificate.narrowest_passage_m >= max(2 * radius_m, 0.8)


@pytest.mark.parametrize("seed", SEEDS)
def test_doors_that_are_all_shut_shut_all_rooms_but_one(seed: int) -> None:
    body = template(*rooms_named("A", "B", "C"), version="2", doorways=(doorway("Target.All", 0.0),))
    world = good_world(body, seed)
    assert len(world.doors) == len(world.passages)
    assert world.certificate.doors_as_set_robot_radius_m == 0.0
    assert len(unreached_rooms(world, RADIUS_M)) == 2


MUSIC: JsonValue = {"Furniture": {"FurnitureArrangements": [furniture({"RoomNames": ["A"]}, ["Pianos"])]}}
REFUSALS: list[tuple[dict[str, JsonValue], JsonValue, str, str]] = [
    ({}, MUSIC, "ModelTypes[0]", f"one of {', '.join(MODEL_TYPES)}"),
    ({"Rooms": [room("A", aspect=(4.1, 1.0))]}, {}, "AspectRatio.x", "from 1 to 4"),
    ({"Ceiling": {"Height": 2.39}}, {}, "Ceiling.Height", "from 2.4 to 4.0"),
    ({"Ceiling": {"Height": 4.01}}, {}, "Ceiling.Height", "from 2.4 to 4.0"),
    ({"Rooms": [room("a" * 256)]}, {}, "Rooms[0].Name", "at most 255 characters"),
    ({"Rooms": [room("Küche")]}, {}, "Rooms[0].Name", "letters, digits, spaces, underscores and hyphens"),
    ({"Rooms": [room(str(n)) for n in range(7)]}, {}, "Rooms", "at most 6 items"),
]


@pytest.mark.parametrize(("plan", "interior", "where", "rule"), REFUSALS, ids=[each[3][:40] for each in REFUSALS])
def test_what_cannot_be_is_refused_by_one_rule_at_one_place(
    plan: dict[str, JsonValue], interior: JsonValue, where: str, rule: str
) -> None:
    floor: JsonValue = {"Floorplan": plan, "Interior": interior}
    with pytest.raises(DocumentError) as refused:
        parse(TemplateBody, {"Version": "1", "Buildings": [{"Floors": [floor]}]})
    (fault,) = refused.value.faults
    assert fault.path.endswith(where)
    assert fault.allowed == rule
