"""Maps: floors as SVG paths, simplified ways, and failures that differ."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jaxtyping import Float

from specs.data.world import FloorZone, Solid
from tasks.results.report.failure_maps import (
    DRAWN,
    LISTED,
    choose_failures,
    dots_path,
    draw_floor,
    fit_line,
    simplify,
    way_path,
)
from tasks.results.report.report_columns import Failures, read_failures, read_ways
from tests.factories.episodes import collided, request
from tests.factories.own_worlds import walled_hall
from tests.factories.reports import written
from tests.factories.worlds import apartment

TOLERANCE_M = 0.05
lines = st.integers(1, 40).flatmap(lambda points: arrays(np.float64, (points, 2), elements=st.floats(-10, 10)))


def test_the_drawing_is_as_large_as_the_world_and_a_margin():
    drawing = draw_floor(apartment())
    assert drawing.view_box == "-268 -218 946 436"


def test_rooms_stand_where_they_are_and_up_is_up():
    living, kitchen = draw_floor(apartment()).rooms
    assert (living.label, kitchen.label) == ("Living room", "Kitchen")
    assert living.x + living.width <= kitchen.x
    assert living.y < 0 < living.y + living.height


def test_zones_are_rooms_and_the_start_is_where_the_world_has_it():
    zone = FloorZone(name="dock", outline_m=((11.0, 6.0), (13.0, 6.0), (13.0, 8.0)), found=False)
    drawing = draw_floor(walled_hall().model_copy(update={"zones": (zone,)}))
    (dock,) = drawing.rooms
    assert (dock.label, dock.outline, dock.x, dock.width) == ("dock", "M1100 -600L1300 -600 1300 -800z", 1100, 200)
    assert (drawing.start, draw_floor(apartment()).start) == ((1100, -600), (0, 0))


def test_a_name_that_does_not_fit_its_room_is_cut():
    drawing = draw_floor(apartment(room_names=("x" * 500, "Kitchen")))
    label = drawing.rooms[0].label
    assert label.endswith("…")
    assert len(label) * 0.56 * drawing.letter <= drawing.rooms[0].width + drawing.letter


def test_what_hangs_above_the_robot_is_not_drawn():
    lamp = Solid(
        name="lintel", shape="box", center_m=(0, 0, 2.3), half_extents_m=(0.1, 0.1, 0.2), yaw_rad=0, color=(1, 1, 1)
    )
    low = lamp.model_copy(update={"center_m": (0, 0, 1.0)})
    assert draw_floor(apartment().model_copy(update={"walls": (lamp,)})).walls == ""
    assert draw_floor(apartment().model_copy(update={"walls": (low,)})).walls == "M-10 10L10 10 10 -10 -10 -10z"


def test_a_way_is_where_the_robot_went_with_each_step_from_the_one_before():
    way_m = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, 0.5], [0.5, -0.25]])
    assert way_path(way_m) == "M0 0l100-50-50 75"


def test_a_way_that_goes_nowhere_is_a_dot_and_none_is_nothing():
    assert way_path(np.array([[0.1, 0.2], [0.1, 0.2]])) == "M10 -20h0"
    assert way_path(np.zeros((0, 2))) == ""
    assert dots_path(np.array([[0.1, 0.2], [1.0, 1.0]])) == "M10 -20h0M100 -100h0"


def away_m(point: Float[np.ndarray, "2"], line: Float[np.ndarray, "points 2"]) -> float:
    begins, ends = line[:-1], line[1:]
    along = ends - begins
    length2 = np.maximum(np.sum(along**2, axis=1), 1e-300)
    share = np.clip(np.sum((point - begins) * along, axis=1) / length2, 0, 1)
    return float(np.min(np.hypot(*(begins + share[:, None] * along - point).T)))


@given(lines)
def test_no_point_is_farther_from_the_new_line_than_allowed(line: Float[np.ndarray, "points 2"]):
    kept = simplify(line, TOLERANCE_M)
    if len(kept) > 1:
        assert max(away_m(point, kept) for point in line) <= TOLERANCE_M + 1e-9


@given(lines)
def test_the_first_and_the_last_point_stay_and_no_point_is_new(line: Float[np.ndarray, "points 2"]):
    kept = simplify(line, TOLERANCE_M)
    assert kept[0].tolist() == line[0].tolist()
    assert kept[-1].tolist() == line[-1].tolist()
    assert {tuple(point) for point in kept.tolist()} <= {tuple(point) for point in line.tolist()}


def test_a_straight_way_is_two_points_however_many_it_had():
    line = np.stack([np.linspace(0, 5, 100), np.linspace(0, 3, 100)], axis=1)
    assert simplify(line, TOLERANCE_M).tolist() == [[0, 0], [5, 3]]


def test_a_corner_stays():
    line = np.array([[0.0, 0.0], [1.0, 0.01], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])
    assert simplify(line, TOLERANCE_M).tolist() == [[0, 0], [2, 0], [2, 2]]


def test_a_way_back_to_where_it_began_is_more_than_a_point():
    line = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 0.0]])
    assert simplify(line, TOLERANCE_M).tolist() == line.tolist()


@given(lines, st.integers(2, 10))
def test_a_line_has_never_more_points_than_there_is_room_for(line: Float[np.ndarray, "points 2"], most: int):
    kept = fit_line(line, TOLERANCE_M, most)
    assert len(kept) <= most
    assert kept[0].tolist() == line[0].tolist()
    assert kept[-1].tolist() == line[-1].tolist()


WORLD = "wgj-1/world-1-1"


def failures(folder: Path, reasons: list[str], ends_m: list[tuple[float, float]] | None = None) -> Failures:
    places = ends_m or [(float(index), 0.0) for index in range(len(reasons))]
    results = [
        collided(index).model_copy(update={"outcome_reason": reason, "final_x_m": x, "final_y_m": y})
        for index, (reason, (x, y)) in enumerate(zip(reasons, places, strict=True))
    ]
    return read_failures(written(folder, [request(index) for index in range(len(reasons))], results)[1])


def test_a_rare_reason_is_shown_among_many_of_another(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["timeout"] * 200 + ["collision"]), [WORLD])[WORLD]
    assert 200 in pick.listed


def test_there_are_never_more_than_are_looked_at(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["timeout", "stuck"] * 100), [WORLD])[WORLD]
    assert (len(pick.listed), len(pick.drawn), pick.failures) == (LISTED, DRAWN, 200)
    assert set(pick.listed) <= set(pick.drawn)


def test_failures_at_other_places_are_listed_before_more_of_the_same_place(tmp_path: Path):
    ends_m = [(0.0, 0.0)] * 10 + [(5.0, 5.0)]
    pick = choose_failures(failures(tmp_path, ["stuck"] * 11, ends_m), [WORLD])[WORLD]
    assert 10 in pick.listed
    assert len(pick.listed) == LISTED


def test_a_world_without_failures_has_nothing_to_show(tmp_path: Path):
    pick = choose_failures(failures(tmp_path, ["stuck"]), ["wgj-1/other"])["wgj-1/other"]
    assert (pick.listed, pick.drawn, pick.failures) == ((), (), 0)


def test_ways_are_read_by_row_also_across_row_groups(tmp_path: Path):
    count = 9_000  # more than one row group
    results = [
        collided(index).model_copy(update={"trajectory": ((0.0, float(index), 1.0, 0.0),)}) for index in range(count)
    ]
    file = written(tmp_path, [request(index) for index in range(count)], results)[1]
    ways = read_ways(file, [3, 8_191, 8_192, 8_999])
    assert {row: way.tolist() for row, way in ways.items()} == {row: [[row, 1.0]] for row in (3, 8_191, 8_192, 8_999)}
