"""A certificate says what is measured on the geometry and what became of each wish, also with less furniture."""

import math
from pathlib import Path

import pytest
from pydantic import JsonValue

from specs.data.world import Certificate, Furniture, RoomFigures, Solid, Wish, World
from specs.errors import DocumentError
from specs.template.body import TemplateBody
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.worlds import encode_world
from tasks.worlds.certificate import broken_guarantees, certify, keep_furniture, weigh_wishes
from tasks.worlds.generate import generate_world
from tasks.worlds.geometry import Box, reaches_room
from tasks.worlds.job.stored_worlds import add_world
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tasks.worlds.survey import survey
from tests.repository import ROOT
from tests.worlds.templates import connection, doorway, furniture, materials, room, template

A: JsonValue = {"RoomNames": ["A"]}


def made(body: TemplateBody) -> World:
    return generate_world(body, seed=2, generation="g", floorplan_index=1, interior_index=1)


def wishes(body: TemplateBody, kind: str) -> list[Wish]:
    return [wish for wish in made(body).certificate.wishes if wish.kind == kind]


def weighed(body: TemplateBody, world: World, free: float = 0.8) -> dict[tuple[str, str], Wish]:
    """Returns the wishes of a template, weighed on a world that may have been made of another."""
    figures = [
        RoomFigures(room=each.name, area_m2=20.0, free_floor_share=free, reached_share=1.0) for each in world.rooms
    ]
    found = weigh_wishes(
        resolve_template(body),
        world.rooms,
        world.passages,
        world.furniture,
        world.doors,
        figures=figures,
        outline_m=(8.0, 4.0),
    )
    return {(wish.kind, wish.subject): wish for wish in found}


def test_areas_and_proportions_have_figures_and_errors() -> None:
    body = template(room("A", area_m2=20.0, aspect=(2.0, 1.0)), footprint=(2.0, 1.0))
    (area,) = wishes(body, "area")
    (aspect,) = wishes(body, "aspect")
    (footprint,) = wishes(body, "footprint")
    assert (area.wished, area.met, area.error) == ("20 m2", True, pytest.approx(0.0, abs=0.03))
    assert (aspect.wished, aspect.met) == ("2:1", True)
    assert (footprint.subject, footprint.wished) == ("footprint", "2:1")


@pytest.mark.parametrize(("error", "met"), [(0.02, True), (0.05, False)])
def test_an_area_is_met_within_three_percent(error: float, *, met: bool) -> None:
    world = made(template(room("A", area_m2=20.0)))
    floor = world.rooms[0].floor
    area = (floor.x_max_m - floor.x_min_m) * (floor.y_max_m - floor.y_min_m)
    assert weighed(template(room("A", area_m2=round(area * (1 + error), 3))), world)["area", "A"].met is met


def test_a_footprint_is_weighed_by_its_outer_faces() -> None:
    wish = weighed(template(room("A"), footprint=(1.0, 2.0)), made(template(room("A"))))["footprint", "footprint"]
    assert (wish.found, wish.met, wish.error) == ("8.00 x 4.00 m, 2:1", False, 3.0)


def test_what_nobody_said_is_no_wish_however_far_it_is_missed() -> None:
    spoiled = weighed(template(room("A"), room("B")), made(template(room("A", aspect=(4.0, 1.0)), room("B"))), 0.1)
    assert spoiled == {}


def test_a_default_that_is_spelled_out_reads_as_one_that_is_left_out() -> None:
    said = template(room("A", area_m2=20.0, aspect=(1.0, 1.0)), footprint=(2.0, 2.0))
    assert made(said).certificate.wishes == ()
    assert made(TemplateBody()).certificate.wishes == ()


def test_an_area_of_its_own_is_a_wish_and_its_square_shape_is_none() -> None:
    body = template(room("A", area_m2=30.0))
    assert [wish.kind for wish in made(body).certificate.wishes] == ["area"]


def test_connections_are_counted_by_pair_and_kind() -> None:
    body = template(room("A"), room("B"), connections=(connection("A", "B"), connection("B", "A")))
    (wish,) = wishes(body, "connection")
    assert (wish.subject, wish.wished, wish.found, wish.met) == ("A - B", "2 doorways", "2 doorways", True)


def test_a_connection_that_is_not_there_is_unmet_and_an_unwished_doorway_does_not_count() -> None:
    world = made(template(room("A"), room("B")))
    asked = template(room("A"), room("B"), connections=(connection("A", "B", "Opening"),))
    wish = weighed(asked, world)["connection", "A - B"]
    assert (wish.wished, wish.found, wish.met) == ("1 opening", "none", False)


def test_rooms_without_wished_materials_have_no_such_wish() -> None:
    assert wishes(template(room("A")), "flooring") == []
    assert wishes(template(room("A")), "walls") == []


def test_a_wished_material_is_met_by_any_of_its_set() -> None:
    (wish,) = wishes(template(room("A"), flooring=(materials(A, "tiles", "CARPET"),)), "flooring")
    assert (wish.wished, wish.met) == ("tiles or CARPET", True)
    assert wish.found in ("Tiles", "Carpet")


def test_an_unknown_material_is_unmet_beside_the_names_there_are() -> None:
    known, unknown = wishes(template(room("A"), walls=(materials(A, "Brick", "Lava"),)), "walls")
    assert (known.found, known.met) == ("Brick", True)
    assert (unknown.wished, unknown.met) == ("Lava", False)
    assert "Wallpaper" in unknown.found


def test_an_empty_list_is_met_by_an_empty_room() -> None:
    (wish,) = wishes(template(room("A"), arrangements=(furniture(A, []),)), "furniture")
    assert (wish.wished, wish.found, wish.met) == ("none", "none", True)
    assert wishes(template(room("A"), arrangements=(furniture(A, []),)), "density") == []


def test_furniture_that_nobody_listed_breaks_the_wish() -> None:
    world = made(template(room("A"), arrangements=(furniture(A, ["Sofas"]),)))
    wish = weighed(template(room("A"), arrangements=(furniture(A, ["Beds"]),)), world)["furniture", "A"]
    assert (wish.wished, wish.found, wish.met) == ("Beds", "Sofas", False)


def test_a_density_is_a_wish_only_where_an_arrangement_says_so() -> None:
    assert wishes(template(room("A")), "density") == []
    assert len(wishes(template(room("A"), arrangements=(furniture(A, density="Sparse"),)), "density")) == 1
    assert len(wishes(template(room("A"), arrangements=(furniture(A, density="Moderate"),)), "density")) == 1


def test_a_list_of_furniture_alone_wishes_no_density() -> None:
    """One toilet never makes a room of 30 m2 moderately full."""
    body = template(room("A", area_m2=30.0), arrangements=(furniture(A, ["Toilets"]),))
    assert wishes(body, "density") == []
    assert len(wishes(body, "furniture")) == 1


@pytest.mark.parametrize("free", [0.2, 0.99])
def test_a_density_outside_its_band_is_unmet(free: float) -> None:
    body = template(room("A"), arrangements=(furniture(A, density="Dense"),))
    wish = weighed(body, made(body), free)["density", "A"]
    assert (wish.found, wish.met) == (f"{100 * free:.0f} % free", False)


def test_a_share_is_weighed_as_it_is_told() -> None:
    body = template(room("A"), arrangements=(furniture(A, density="Sparse"),))
    world = made(body)
    told = weighed(body, world, 0.9)["density", "A"].wished
    least = int(told.split("(")[1].split(" ")[0]) / 100
    assert weighed(body, world, least - 0.004)["density", "A"].met


def test_doors_stand_as_wished_and_only_named_ones_are_wishes() -> None:
    pair: JsonValue = {"From": {"RoomNames": ["A"]}, "To": {"RoomNames": ["B"]}}
    rooms = (room("A"), room("B"), room("C"))
    ways = (connection("A", "B"), connection("B", "C"))
    (wish,) = wishes(template(*rooms, connections=ways, version="2", doorways=(doorway(pair, 40),)), "door")
    assert (wish.subject, wish.wished, wish.found, wish.met) == ("A - B", "40 % open", "40 % open", True)


def test_unmet_wishes_are_sentences() -> None:
    world = made(template(room("A"), walls=(materials(A, "Lava"),)))
    assert [sentence for sentence in world.certificate.unmet if "Lava" in sentence and sentence.startswith("A: ")]


BODY = template(room("A", area_m2=20.0), room("B", area_m2=20.0))
BRIEF = resolve_template(BODY)


def sound_world() -> World:
    return generate_world(BODY, seed=3, generation="wgj-1", floorplan_index=1, interior_index=1)


def certificate(made: World, *more: Solid, resolved: ResolvedTemplate = BRIEF) -> Certificate:
    extra = [
        Furniture(name=each.name, model_type="Ottomans", room="A", center_m=(0.0, 0.0), yaw_rad=0.0, solids=(each,))
        for each in more
    ]
    return certify(
        resolved, made.rooms, made.passages, walls=made.walls, furniture=(*made.furniture, *extra), doors=made.doors
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
    made = sound_world()
    assert certificate(made) == made.certificate
    assert broken_guarantees(made.certificate) == ()


def test_a_post_near_the_start_breaks_the_clear_metre() -> None:
    found = certificate(sound_world(), post(0.3, 0.4, 0.1))
    assert found.origin_clear_radius_m == pytest.approx(0.4)
    assert "0.4 m around the start" in broken_guarantees(found)[0]


def test_what_hangs_above_heads_is_not_in_the_way() -> None:
    made = sound_world()
    assert certificate(made, post(0.0, 0.0, 0.5, bottom=2.2)).origin_clear_radius_m > 1.0


def test_a_blocked_doorway_shuts_a_room_off() -> None:
    made = sound_world()
    found = certificate(made, post(*made.passages[0].center_m, 0.3))
    assert found.reachable_robot_radius_m < 0.25
    assert any("does not reach every room" in sentence for sentence in broken_guarantees(found))


def test_a_piece_in_a_wall_is_an_overlap() -> None:
    made = sound_world()
    x, y, _ = made.walls[0].center_m
    found = certificate(made, post(x, y, 0.2))
    assert found.overlaps >= 1
    assert any("overlap" in sentence for sentence in broken_guarantees(found))


def test_the_radius_never_exceeds_half_the_narrowest_passage() -> None:
    found = sound_world().certificate
    assert found.narrowest_passage_m == 0.9
    assert 0.3 < found.reachable_robot_radius_m <= 0.45


@pytest.mark.parametrize("offset_m", [0.0, 0.1, 0.2, 0.35, 0.6])
def test_the_radius_is_the_largest_that_reaches_every_room(offset_m: float) -> None:
    made = sound_world()
    x, y, _ = (*made.passages[0].center_m, 0.0)
    aside = (x + offset_m, y) if made.passages[0].along == "x" else (x, y + offset_m)
    blocked = Furniture(
        name="post", model_type="Ottomans", room="A", center_m=aside, yaw_rad=0.0, solids=(post(*aside, 0.05),)
    )
    furniture = (*made.furniture, blocked)
    clear = survey(made.rooms, made.passages, made.walls, furniture, made.doors, radius_m=0.25).opened
    floors = [Box(*room.floor.model_dump().values()) for room in made.rooms]
    radii = [step / 100 for step in range(1, 101)]
    reached = [all(reaches_room(clear.reached(r), clear, floor, r) for floor in floors) for r in radii]
    largest = max((radius for radius, found in zip(radii, reached, strict=True) if found), default=0.0)
    assert certificate(made, post(*aside, 0.05)).reachable_robot_radius_m == pytest.approx(largest)


def test_missed_areas_and_aspects_are_named_with_numbers() -> None:
    other = resolve_template(template(room("A", area_m2=25.0), room("B", area_m2=20.0, aspect=(4.0, 1.0))))
    found = certificate(sound_world(), resolved=other)
    assert found.area_error_mean == pytest.approx(0.1, abs=0.01)
    assert any(sentence.startswith("A: 20.0 m2, wished 25 m2") for sentence in found.unmet)
    assert any(sentence.startswith("B: ") and "wished 4:1" in sentence for sentence in found.unmet)


def test_free_floor_is_what_furniture_leaves() -> None:
    made = sound_world()
    less = certificate(made, post(0.0, 0.0, 0.5)).free_floor_share
    assert made.certificate.free_floor_share - less == pytest.approx(math.pi / 4 / 40.0, rel=0.1)


TEMPLATE = TemplateBody.model_validate_json((ROOT / "examples" / "templates" / "two-rooms.json").read_bytes())


@pytest.fixture(scope="module")
def world() -> World:
    return generate_world(TEMPLATE, seed=7, generation="wgj-1", floorplan_index=1, interior_index=1)


@pytest.fixture(scope="module")
def half(world: World) -> World:
    return keep_furniture(world, {piece.name for piece in world.furniture[::2]}, TEMPLATE)


@pytest.mark.parametrize("template", [TEMPLATE, None])
def test_with_all_its_furniture_a_world_measures_what_its_generator_measured(
    world: World, template: TemplateBody | None
):
    again = keep_furniture(world, {piece.name for piece in world.furniture}, template)
    assert again.map == world.map
    left_out = {"wishes"}
    assert again.certificate.model_dump(exclude=left_out) == world.certificate.model_dump(exclude=left_out)
    assert again.certificate.wishes[-1].met


def test_the_wishes_of_a_known_template_are_weighed_anew(world: World, half: World):
    assert [wish.kind for wish in half.certificate.wishes[:-1]] == [wish.kind for wish in world.certificate.wishes]


def test_what_was_taken_out_is_gone_from_map_and_certificate(world: World, half: World):
    assert half.furniture == world.furniture[::2]
    assert half.map.runs != world.map.runs
    assert half.certificate.free_floor_share > world.certificate.free_floor_share
    assert broken_guarantees(half.certificate) == ()


def test_nobody_takes_it_for_a_world_that_was_generated(world: World, half: World):
    assert half.generator == f"{world.generator}-shrunk"
    assert half.certificate.unmet[-1].startswith(f"all rooms: {len(half.furniture)} left, wished")
    assert keep_furniture(half, set(), None).generator == half.generator


def test_without_a_template_wishes_about_furniture_are_left_out(world: World):
    full = Wish(kind="density", subject="Living room", wished="Dense", found="Dense", met=True)
    said = world.certificate.model_copy(update={"wishes": (*world.certificate.wishes, full)})
    bare = keep_furniture(world.model_copy(update={"certificate": said}), set(), None).certificate
    kinds = {wish.kind for wish in bare.wishes[:-1]}
    assert kinds
    assert not kinds & {"furniture", "density"}
    assert bare.area_error_mean == world.certificate.area_error_mean


def test_a_world_is_added_once_under_its_name(file_store: Store, half: World, tmp_path: Path):
    file = tmp_path / "world.json"
    file.write_bytes(encode_world(half))
    for _ in range(2):
        assert add_world(file_store, file) == "wgj-1/world-1-1"
    assert file_store.get(world_key("wgj-1", "world-1-1")).body == encode_world(half)


def test_a_world_does_not_take_the_name_of_another(file_store: Store, world: World, half: World, tmp_path: Path):
    file_store.put(world_key("wgj-1", "world-1-1"), encode_world(world))
    file = tmp_path / "world.json"
    file.write_bytes(encode_world(half))
    with pytest.raises(DocumentError, match="a name that no other world has there"):
        add_world(file_store, file)
    assert file_store.get(world_key("wgj-1", "world-1-1")).body == encode_world(world)


def test_a_world_that_says_what_is_not_so_is_refused(file_store: Store, world: World, half: World, tmp_path: Path):
    file = tmp_path / "world.json"
    for claimed in ({"certificate": world.certificate}, {"map": world.map}):
        file.write_bytes(encode_world(half.model_copy(update=claimed)))
        with pytest.raises(DocumentError, match="what is measured on the world's geometry"):
            add_world(file_store, file)


def test_what_is_no_world_is_refused(file_store: Store, tmp_path: Path):
    file = tmp_path / "world.json"
    with pytest.raises(DocumentError, match="the document of a world"):
        add_world(file_store, file)
    file.write_text("{}")
    with pytest.raises(DocumentError, match="the document of a world"):
        add_world(file_store, file)
