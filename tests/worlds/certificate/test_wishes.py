"""Every wish of a template stands in the certificate beside what came of it."""

import pytest
from pydantic import JsonValue

from specs.data.world import RoomFigures, Wish, World
from specs.template.body import TemplateBody
from tasks.worlds.certificate import weigh_wishes
from tasks.worlds.generate import generate_world
from tasks.worlds.resolved_template import resolve_template
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
