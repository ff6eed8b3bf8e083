"""A template becomes a brief with all precedence resolved."""

from specs.template.body import TemplateBody
from tasks.worlds.resolved_template import ConnectionWish, resolve_template
from tests.worlds.templates import connection, furniture, materials, room, template


def test_furniture_by_name_beats_by_type_beats_for_all() -> None:
    sets = (
        furniture("Target.All", ["Ottomans"], "Sparse"),
        furniture({"RoomTypes": ["Bedroom"]}, ["Beds"], "Dense"),
        furniture({"RoomNames": ["Mine"]}, [], "Moderate"),
    )
    rooms = (room("Hall", "Hallway"), room("Yours", "Bedroom"), room("Mine", "Bedroom"))
    brief = resolve_template(template(*rooms, arrangements=sets, version="2"))
    assert [each.furniture for each in brief.rooms] == [("Ottomans",), ("Beds",), ()]
    assert [each.density for each in brief.rooms] == ["Sparse", "Dense", "Moderate"]


def test_of_two_sets_at_the_same_level_the_first_wins() -> None:
    sets = (materials({"RoomTypes": ["Living"]}, "Carpet"), materials({"RoomTypes": ["Living"]}, "Tiles"))
    assert resolve_template(template(room("A"), flooring=sets)).rooms[0].floorings == ("Carpet",)


def test_a_set_without_samples_leaves_the_choice_to_the_generator() -> None:
    wish = resolve_template(template(room("A"), arrangements=(furniture({"RoomNames": ["A"]}, None, "Dense"),))).rooms[
        0
    ]
    assert (wish.furniture, wish.density) == (None, "Dense")


def test_an_untargeted_room_is_moderately_furnished() -> None:
    wish = resolve_template(TemplateBody()).rooms[0]
    assert (wish.furniture, wish.density, wish.floorings, wish.walls) == (None, "Moderate", (), ())


def test_aspects_are_width_over_depth() -> None:
    brief = resolve_template(template(room("A", aspect=(1.0, 2.0)), footprint=(4.0, 1.0)))
    assert (brief.rooms[0].aspect, brief.footprint_aspect) == (0.5, 4.0)


def test_connections_name_rooms_by_place_lower_first() -> None:
    brief = resolve_template(template(room("A"), room("B"), connections=(connection("B", "A", "Opening"),)))
    assert brief.connections == (ConnectionWish((0, 1), "Opening"),)


def test_doorways_of_version_1_have_no_doors() -> None:
    assert resolve_template(template(room("A"), room("B"))).doors is None


def test_doorways_of_version_2_have_open_doors_unless_it_says_otherwise() -> None:
    doors = resolve_template(template(room("A"), room("B"), version="2")).doors
    assert doors is not None
    assert doors.opening((0, 1)) == 100.0


def test_the_robot_that_a_world_is_made_for_is_part_of_the_brief() -> None:
    assert resolve_template(template(room("A")), 0.4).robot_radius_m == 0.4
