"""Lines with fewer points: never farther away than allowed, and the same where they begin and end."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from jaxtyping import Float

from tasks.results.report.floor import fitted, simplified

TOLERANCE_M = 0.05
lines = st.integers(1, 40).flatmap(lambda points: arrays(np.float64, (points, 2), elements=st.floats(-10, 10)))


def away_m(point: Float[np.ndarray, "2"], line: Float[np.ndarray, "points 2"]) -> float:
    begins, ends = line[:-1], line[1:]
    along = ends - begins
    length2 = np.maximum(np.sum(along**2, axis=1), 1e-300)
    share = np.clip(np.sum((point - begins) * along, axis=1) / length2, 0, 1)
    return float(np.min(np.hypot(*(begins + share[:, None] * along - point).T)))


@given(lines)
def test_no_point_is_farther_from_the_new_line_than_allowed(line: Float[np.ndarray, "points 2"]):
    kept = simplified(line, TOLERANCE_M)
    if len(kept) > 1:
        assert max(away_m(point, kept) for point in line) <= TOLERANCE_M + 1e-9


@given(lines)
def test_the_first_and_the_last_point_stay_and_no_point_is_new(line: Float[np.ndarray, "points 2"]):
    kept = simplified(line, TOLERANCE_M)
    assert kept[0].tolist() == line[0].tolist()
    assert kept[-1].tolist() == line[-1].tolist()
    assert {tuple(point) for point in kept.tolist()} <= {tuple(point) for point in line.tolist()}


def test_a_straight_way_is_two_points_however_many_it_had():
    line = np.stack([np.linspace(0, 5, 100), np.linspace(0, 3, 100)], axis=1)
    assert simplified(line, TOLERANCE_M).tolist() == [[0, 0], [5, 3]]


def test_a_corner_stays():
    line = np.array([[0.0, 0.0], [1.0, 0.01], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])
    assert simplified(line, TOLERANCE_M).tolist() == [[0, 0], [2, 0], [2, 2]]


def test_a_way_back_to_where_it_began_is_more_than_a_point():
    line = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 0.0]])
    assert simplified(line, TOLERANCE_M).tolist() == line.tolist()


@given(lines, st.integers(2, 10))
def test_a_line_has_never_more_points_than_there_is_room_for(line: Float[np.ndarray, "points 2"], most: int):
    kept = fitted(line, TOLERANCE_M, most)
    assert len(kept) <= most
    assert kept[0].tolist() == line[0].tolist()
    assert kept[-1].tolist() == line[-1].tolist()
