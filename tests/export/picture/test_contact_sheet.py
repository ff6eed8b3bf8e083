"""A sheet shows the first worlds of a job, at one scale, in bounded size and memory."""

from collections.abc import Iterator
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given

from specs.data.world import Rectangle, Wish, World
from tasks.export.picture.contact_sheet import MOST_WORLDS, contact_sheet_svg, summary
from tests.export.variants import with_door, with_windows
from tests.factories.worlds import apartment, apartments

SVG = "{http://www.w3.org/2000/svg}"
WISH = Wish(kind="area", subject="Kitchen", wished="16 m2", found="14 m2", met=False, error=0.125)


def worlds(count: int) -> list[World]:
    return [apartment(name=f"world-{number}-1") for number in range(1, count + 1)]


def drawn(*shown: World, total: int | None = None) -> ET.Element:
    return ET.fromstring(contact_sheet_svg(shown, title="wgj-1", total=total))  # noqa: S314 - our own document


def texts(root: ET.Element) -> list[str]:
    return [found.text or "" for found in root.iter(f"{SVG}text")]


def wishing(world: World, *wishes: Wish) -> World:
    return world.model_copy(update={"certificate": world.certificate.model_copy(update={"wishes": wishes})})


def plans(root: ET.Element) -> list[ET.Element]:
    return [found for found in root.iter(f"{SVG}g") if found.get("class") == "plan"]


@given(apartments())
def test_a_sheet_is_well_formed_whatever_the_names(world: World):
    assert drawn(world).tag == f"{SVG}svg"


def test_a_name_with_markup_is_shown_and_not_obeyed():
    root = drawn(apartment(room_names=("<script>", "A & B")))
    assert not list(root.iter(f"{SVG}script"))
    assert "A & B" in texts(root)


def test_every_world_is_drawn_with_its_rooms_and_doors_and_named():
    root = drawn(*worlds(5), with_door(40.0, with_windows(apartment(name="hinged"))))
    assert len(plans(root)) == 6
    assert {f"world-{number}-1" for number in range(1, 6)} | {"hinged"} <= set(texts(root))
    (last,) = [plan for plan in plans(root) if plan.findtext(f"{SVG}title") == "hinged"]
    classes = {found.get("class") for found in last.iter()}
    assert {"doorway", "door", "window", "wall", "leaf", "clear"} <= classes
    assert {"Living room", "Kitchen"} <= {found.text for found in last.iter(f"{SVG}text")}


def test_each_world_tells_its_figures_and_what_it_does_not_fulfil():
    shown = texts(drawn(wishing(apartment(), WISH), wishing(apartment(), WISH.model_copy(update={"met": True}))))
    assert "36.0 m² · 86 % free · robot up to 0.41 m" in shown
    assert "1 of 1 wishes not fulfilled" in shown
    assert "every wish fulfilled" in shown


def test_a_sheet_has_room_for_so_many_and_tells_how_many_there_are():
    root = drawn(*worlds(MOST_WORLDS + 7))
    assert len(plans(root)) == MOST_WORLDS
    assert any(f"the first {MOST_WORLDS} of {MOST_WORLDS + 7} worlds" in text for text in texts(root))


def test_a_total_that_is_told_is_not_counted():
    def one_more_than_is_drawn() -> Iterator[World]:
        yield from worlds(MOST_WORLDS)
        pytest.fail("a world was read that is not drawn")

    sheet = contact_sheet_svg(one_more_than_is_drawn(), title="any", total=10_000)
    assert f"the first {MOST_WORLDS} of 10000 worlds" in sheet


def test_twenty_four_worlds_are_less_than_a_megabyte():
    assert len(contact_sheet_svg([with_door(40.0, with_windows())] * 24, title="any").encode()) < 1_000_000


def test_all_plans_have_one_scale():
    small = apartment(name="small")
    large = small.model_copy(
        update={"name": "large", "footprint": Rectangle(x_min_m=-10.0, y_min_m=-2.1, x_max_m=10.0, y_max_m=2.1)}
    )
    radii = {found.get("r") for found in drawn(small, large).iter(f"{SVG}circle") if found.get("class") == "clear"}
    assert len(radii) == 1


def test_plans_do_not_cover_each_other_and_stay_on_the_sheet():
    root = drawn(*worlds(7))
    _, _, width, height = (float(part) for part in root.get("viewBox", "").split())
    frames = [next(plan.iter(f"{SVG}rect")) for plan in plans(root)]
    boxes = [[float(frame.get(name, "nan")) for name in ("x", "y", "width", "height")] for frame in frames]
    for number, (x, y, across, down) in enumerate(boxes):
        assert 0 < x < x + across < width
        assert 0 < y < y + down < height
        for left, top, *_ in boxes[:number]:
            assert abs(x - left) > across or abs(y - top) > down


def test_the_summary_is_about_all_that_is_shown():
    narrow = apartment().model_copy(
        update={"certificate": apartment().certificate.model_copy(update={"reachable_robot_radius_m": 0.3})}
    )
    told = summary([wishing(apartment(), WISH), narrow], 2)
    assert told.startswith("2 worlds · 36 m² · ")
    assert "a robot of 0.30 m radius" in told
    assert told.endswith("0 of 1 wishes fulfilled")


def test_doors_that_keep_a_robot_out_are_told_beside_the_reach():
    shut = apartment().certificate.model_copy(update={"doors_as_set_robot_radius_m": 0.08})
    world = apartment().model_copy(update={"certificate": shut})
    assert "0.41 m radius · with doors as set: up to 0.08 m" in summary([world], 1)


def test_a_sheet_without_worlds_is_refused():
    with pytest.raises(ValueError, match="needs a world"):
        contact_sheet_svg([], title="any")


def test_the_same_worlds_give_the_same_text():
    first = contact_sheet_svg(worlds(3), title="any")
    assert contact_sheet_svg(iter(worlds(3)), title="any") == first
