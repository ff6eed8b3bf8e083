"""A thing seen from its front: nothing that hides is drawn before what it hides, and all pictures have one scale."""

from xml.etree import ElementTree as ET

import pytest

from specs.data.world import Rectangle, Solid
from tasks.export.drawing.furniture_drawing import solid_view_svg

SVG = "{http://www.w3.org/2000/svg}"
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def box(
    x: float, y: float, z: float, color: tuple[float, float, float] = RED, *, half: float = 0.5, yaw: float = 0.0
) -> Solid:
    return Solid(
        name="box",
        shape="box",
        center_m=(x, y, z),
        half_extents_m=(half, half, half),
        yaw_rad=yaw,
        color=color,
    )


def drawn(*solids: Solid, clear: Rectangle | None = None) -> ET.Element:
    return ET.fromstring(solid_view_svg("a thing", solids, clear))  # noqa: S314 - our own document


def faces(*solids: Solid, clear: Rectangle | None = None) -> list[ET.Element]:
    root = drawn(*solids, clear=clear)
    return [*root.iter(f"{SVG}path"), *root.iter(f"{SVG}ellipse")]


def order(*solids: Solid) -> str:
    """Returns the colours of all faces in the order in which they are drawn: r for red, b for blue."""
    fills = [face.get("fill", "") for face in faces(*solids)]
    return "".join("r" if fill[1:3] > fill[5:7] else "b" for fill in fills)


def test_one_sees_three_faces_of_a_box_and_the_wall_and_the_top_of_a_cylinder():
    assert len(faces(box(0, 0, 0.5))) == 3
    assert len(faces(box(0, 0, 0.5, yaw=0.7))) == 3
    assert len(faces(box(0, 0, 0.5).model_copy(update={"shape": "cylinder"}))) == 2


@pytest.mark.parametrize(
    "nearer", [(1.0, 0.0, 0.5), (0.0, 1.0, 0.5), (0.0, 0.0, 1.5)], ids=["beside", "before", "above"]
)
def test_what_is_nearer_to_the_eye_is_drawn_last(nearer: tuple[float, float, float]):
    far, near = box(0, 0, 0.5, BLUE), box(*nearer, RED)
    assert order(far, near) == order(near, far) == "bbbrrr"


def test_a_small_thing_on_a_large_one_is_drawn_after_it_wherever_it_lies():
    table = box(0, 0, 0.5, BLUE, half=0.5)
    cup = box(-0.4, -0.4, 1.05, RED, half=0.05)
    assert order(cup, table) == "bbbrrr"


def test_things_that_overlap_are_drawn_all_the_same():
    assert len(faces(*(box(0.1 * n, 0, 0.5) for n in range(5)))) == 15


def test_the_floor_that_is_kept_free_is_outlined_below_all_else():
    floor = Rectangle(x_min_m=-1, x_max_m=1, y_min_m=0.5, y_max_m=1.5)
    found = faces(box(0, 0, 0.5), clear=floor)
    assert [face.get("class") for face in found] == ["clear", None, None, None]


def test_a_metre_is_as_long_in_each_picture():
    one, two = (drawn(box(0, 0, 1, half=half)).get("width", "") for half in (0.5, 1.0))
    assert float(two) - 16 == pytest.approx(2 * (float(one) - 16), abs=1.5)
