"""Boxes on every engine: they stand at their times alone, stop robots alike, and count as the solids that they are."""

from typing import NamedTuple

import numpy as np
import pytest

from specs.data.boxes import Box
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.geometry.obstacles import PARKING_M
from tests.factories.simulations import driven_chunk, pushing

LANES, STEPS = 8, 120
APPEARS_S, LEAVES_S = 1.0, 4.0
# On both sides of the middle, in which robots start.
BOXES = tuple(
    Box(size_m=(0.3, 1.2, 0.6), at_m=(x_m, 0.0), appears_s=APPEARS_S, leaves_s=LEAVES_S) for x_m in (0.75, -0.75)
)


class Driven(NamedTuple):
    """What a chunk gave: a row and its paths for each lane."""

    rows: list[EpisodeResult]
    pose: np.ndarray
    boxes_m: np.ndarray


def among_boxes(index: int, boxes: tuple[Box, ...] | None = BOXES) -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, duration_s=0.05 * STEPS)
    return drawn.model_copy(update={"boxes": boxes})


def driven(requests: list[EpisodeRequest], pens: dict[str, World], engine: str) -> Driven:
    rows, whole = driven_chunk(requests, pens, engine, LANES)
    boxes_m = np.zeros((LANES, STEPS, 0, 2)) if whole.boxes_m is None else np.asarray(whole.boxes_m)
    return Driven(rows, np.asarray(whole.pose)[:LANES, :STEPS], boxes_m[:LANES, :STEPS])


@pytest.fixture(scope="module")
def planar(pens: dict[str, World]) -> Driven:
    return driven([among_boxes(k) for k in range(LANES)], pens, "planar")


@pytest.fixture(scope="module", params=["mujoco", pytest.param("mjx", marks=pytest.mark.long)])
def other(request: pytest.FixtureRequest, pens: dict[str, World]) -> Driven:
    return driven([among_boxes(k) for k in range(LANES)], pens, request.param)


@pytest.fixture(scope="module")
def free(pens: dict[str, World]) -> Driven:
    return driven([among_boxes(k, None) for k in range(LANES)], pens, "planar")


def standing(found: Driven, boxes: int) -> np.ndarray:
    """Returns which boxes stand at the end of each control step."""
    assert (found.boxes_m[:, :, boxes:, 1] == PARKING_M).all()
    return found.boxes_m[:, :, :boxes, 1] < PARKING_M


def test_boxes_stand_at_their_times(planar: Driven):
    there, begins, ends = standing(planar, len(BOXES)), round(APPEARS_S * 20), round(LEAVES_S * 20)
    assert not there[:, :begins].any()
    assert not there[:, ends:].any()
    assert there[:, begins].mean() > 0.5
    assert not (there[:, begins : ends - 1] & ~there[:, begins + 1 : ends]).any()  # what has come stays


def test_a_box_appears_once_the_robot_has_left_its_place(free: Driven, pens: dict[str, World]):
    x_m, y_m, _ = free.pose[0, 0].tolist()
    on_it = (Box(size_m=(0.2, 0.2, 0.4), at_m=(x_m, y_m)),)
    found = driven([among_boxes(k, on_it) for k in range(LANES)], pens, "planar")
    there = standing(found, 1)[:, :, 0]
    assert not there[0, 0]
    assert there.any(axis=1).all()
    for lane, first in enumerate(there.argmax(axis=1)):
        assert np.hypot(*(found.pose[lane, max(first - 1, 0), :2] - [x_m, y_m])) > 0.2
    assert all(row.min_clearance_m > -0.01 for row in found.rows)


def test_a_box_stops_a_robot_and_is_no_person(planar: Driven, free: Driven):
    begins = round(APPEARS_S * 20)
    np.testing.assert_array_equal(planar.pose[:, :begins], free.pose[:, :begins])
    assert (planar.pose[:, begins:] != free.pose[:, begins:]).any()
    assert any(ours.collisions != theirs.collisions for ours, theirs in zip(planar.rows, free.rows, strict=True))
    assert {row.person_contacts for row in planar.rows} == {None}
    assert all(row.min_clearance_m > -0.01 for row in planar.rows)


def test_robots_meet_boxes_as_on_the_planar_engine(planar: Driven, other: Driven):
    for ours, theirs in zip(other.rows, planar.rows, strict=True):
        assert (ours.outcome_reason, ours.collisions) == (theirs.outcome_reason, theirs.collisions)
        assert ours.min_clearance_m == pytest.approx(theirs.min_clearance_m, abs=1e-3)
        assert ours.impulse_ns == pytest.approx(theirs.impulse_ns, rel=5e-3, abs=1e-2)
        assert (ours.final_x_m, ours.final_y_m) == pytest.approx((theirs.final_x_m, theirs.final_y_m), abs=1e-2)
    np.testing.assert_array_equal(standing(other, len(BOXES)), standing(planar, len(BOXES)))


@pytest.mark.parametrize(
    "engine", ["planar", pytest.param("mujoco", marks=pytest.mark.long), pytest.param("mjx", marks=pytest.mark.long)]
)
def test_an_episode_with_boxes_alone_has_the_row_that_it_has_among_others(pens: dict[str, World], engine: str):
    together = driven([among_boxes(k) for k in range(LANES)], pens, engine)
    assert driven([among_boxes(5)], pens, engine).rows == [together.rows[5]]
