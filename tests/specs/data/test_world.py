"""The world document: prisms, and what version 1 has not."""

import pytest
from pydantic import ValidationError

from specs.data.world import RecordedWalk, Solid, Start, World, start_pose
from tests.factories.worlds import apartment

CORNERS = ((-0.5, -0.5), (0.5, -0.5), (0.0, 0.5))


def prism(**changes: object) -> Solid:
    """Returns a triangular prism with some fields changed, checked."""
    fields = {
        "name": "wedge",
        "shape": "prism",
        "center_m": (1.0, 0.0, 0.5),
        "half_extents_m": (0.5, 0.5, 0.5),
        "yaw_rad": 0.3,
        "color": (0.5, 0.5, 0.5),
        "outline_m": CORNERS,
    }
    return Solid.model_validate(fields | changes)


def test_a_prism_has_corners():
    assert prism().outline_m == CORNERS
    assert "outline_m" in prism().model_dump()


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"outline_m": None}, "corners for a prism"),
        ({"shape": "box"}, "none for another shape"),
        ({"outline_m": CORNERS[:2]}, "3 to 8 corners"),
        ({"outline_m": CORNERS[::-1]}, "counter-clockwise"),
        ({"outline_m": (*CORNERS, (0.0, 0.0))}, "convex"),
        ({"outline_m": CORNERS * 2}, "convex"),
        ({"half_extents_m": (0.5, 0.4, 0.5)}, "reach from -half_extents_m"),
        ({"outline_m": ((-0.5, -0.5), (0.5, -0.5), (0.0, float("inf")))}, "convex"),
    ],
)
def test_an_outline_that_is_none_is_refused(changes: dict[str, object], allowed: str):
    with pytest.raises(ValidationError, match=allowed):
        prism(**changes)


def test_a_generated_world_has_nothing_of_version_2():
    fields = set(apartment().model_dump())
    assert not fields & {"start", "source", "report"}
    assert "outline_m" not in apartment().model_dump()["walls"][0]
    assert start_pose(apartment()) == Start(x_m=0.0, y_m=0.0, yaw_rad=0.0)


@pytest.mark.parametrize("later", [{"start": {"x_m": 1.0, "y_m": 2.0}}, {"walls": [prism().model_dump()]}])
def test_what_came_with_version_2_needs_it(later: dict[str, object]):
    fields = apartment().model_dump() | later
    with pytest.raises(ValidationError, match='version "2" for '):
        World.model_validate(fields)
    assert World.model_validate(fields | {"version": "2"}).version == "2"


@pytest.mark.parametrize(
    "changes",
    [{"times_s": [0.0, 1.0]}, {"times_s": [0.0, 2.0, 1.0]}, {"times_s": [-1.0, 0.0, 1.0]}, {"period_s": 0.0}],
)
def test_a_walk_whose_times_do_not_fit_its_places_is_refused(changes: dict[str, object]):
    walk = {"name": "anna", "times_s": [0.0, 1.0, 2.0], "points_m": [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]}
    RecordedWalk.model_validate(walk)
    with pytest.raises(ValidationError, match=r"ascending|above 0"):
        RecordedWalk.model_validate({**walk, **changes})
