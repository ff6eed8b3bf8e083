"""People on every engine: they walk the same ways, stop robots alike, and what they push is no solid's."""

from itertools import groupby
from typing import NamedTuple

import numpy as np
import pytest

from specs.data.episode import CONTROL_S, EpisodeRequest, EpisodeResult
from specs.data.people import PERSON_RADIUS_M, PERSONAL_M, STANDING_M_S, People
from specs.data.world import World
from tests.factories.simulations import driven_chunk, pushing

LANES, STEPS = 8, 240
HULL_M = 0.2
# Where a person is so near to a robot, the robot's last bits decide where it stops.
NEAR_M = 0.3 + PERSON_RADIUS_M


class Driven(NamedTuple):
    """What a chunk gave: a row and its paths for each lane."""

    rows: list[EpisodeResult]
    pose: np.ndarray
    people_m: np.ndarray
    speed_m_s: np.ndarray

    def frozen_s(self, lane: int, below_m_s: float) -> float:
        """Returns the longest time in one go in which a lane's robot was near a person and slower than that."""
        pose, begins_m_s = self.pose[lane, :STEPS], np.append(0.0, self.speed_m_s[lane, : STEPS - 1])
        away_m = np.hypot(*np.moveaxis(self.people_m[lane, :STEPS, :3] - pose[:, None, :2], -1, 0)).min(axis=1)
        slow = (begins_m_s < below_m_s) & (away_m - HULL_M - PERSON_RADIUS_M < PERSONAL_M)
        return CONTROL_S * max(sum(steps) for _, steps in groupby(slow.tolist()))


def among_people(index: int) -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, duration_s=0.05 * STEPS)
    return drawn.model_copy(update={"people": People(count=3, unaware=1.0)})


def driven(requests: list[EpisodeRequest], pens: dict[str, World], engine: str) -> Driven:
    rows, whole = driven_chunk(requests, pens, engine, LANES)
    speed_m_s = np.hypot(*np.moveaxis(np.asarray(whole.velocity)[..., :2], -1, 0))
    return Driven(rows, np.asarray(whole.pose), np.asarray(whole.people_m), speed_m_s)


@pytest.fixture(scope="module")
def planar(pens: dict[str, World]) -> Driven:
    return driven([among_people(k) for k in range(LANES)], pens, "planar")


@pytest.fixture(scope="module", params=["mujoco", pytest.param("mjx", marks=pytest.mark.long)])
def other(request: pytest.FixtureRequest, pens: dict[str, World]) -> Driven:
    return driven([among_people(k) for k in range(LANES)], pens, request.param)


def test_people_walk_the_same_ways_until_a_robot_is_in_them(planar: Driven, other: Driven):
    compared = 0
    for lane in range(LANES):
        here, there = planar.people_m[lane, :, :3], other.people_m[lane, :, :3]
        away_m = np.hypot(*np.moveaxis(here - planar.pose[lane, :, None, :2], -1, 0)).min(axis=1)
        free = int(np.argmax(away_m < NEAR_M)) if (away_m < NEAR_M).any() else len(away_m)
        free = min(free, len(there))
        # The compiler rounds the same code otherwise in other company.
        np.testing.assert_allclose(there[:free], here[:free], atol=1e-5)
        compared += free
    assert compared > LANES * STEPS // 4


def test_robots_meet_people_as_on_the_planar_engine(planar: Driven, other: Driven):
    assert sum(bool(row.person_contacts) for row in planar.rows) >= LANES // 4
    for lane, (ours, theirs) in enumerate(zip(other.rows, planar.rows, strict=True)):
        for name in ("outcome_reason", "person_contacts", "person_standing_contacts", "collisions"):
            assert getattr(ours, name) == getattr(theirs, name)
        assert ours.min_person_m == pytest.approx(theirs.min_person_m, abs=1e-3)
        assert ours.person_contact_m_s == pytest.approx(theirs.person_contact_m_s, abs=1e-3)
        for name in ("person_energy_j", "person_force_n", "person_force_margin", "min_person_collision_s"):
            found, expected = (np.array(getattr(row, name), np.float64) for row in (ours, theirs))
            np.testing.assert_allclose(found, expected, rtol=1e-2, atol=5e-3, err_msg=name)
        assert ours.person_frozen_s is not None
        # A robot that presses against a person trembles, and the last bits decide in which step it is above a speed.
        least_s, most_s = (planar.frozen_s(lane, share * STANDING_M_S) for share in (0.5, 2.0))
        assert least_s - 0.11 <= ours.person_frozen_s <= most_s + 0.11
        assert ours.impulse_ns == pytest.approx(theirs.impulse_ns, rel=5e-3, abs=1e-2)
        assert (ours.final_x_m, ours.final_y_m) == pytest.approx((theirs.final_x_m, theirs.final_y_m), abs=1e-2)


def test_a_robot_is_frozen_for_as_long_as_its_own_way_says(planar: Driven, other: Driven):
    for drove in (planar, other):
        found_s = [row.person_frozen_s for row in drove.rows]
        assert found_s == pytest.approx([drove.frozen_s(lane, STANDING_M_S) for lane in range(LANES)], abs=0.01)
        assert max(filter(None, found_s)) > 0.5


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("mjx", marks=pytest.mark.long)])
def test_an_episode_among_people_alone_has_the_row_that_it_has_among_others(pens: dict[str, World], engine: str):
    together = driven([among_people(k) for k in range(LANES)], pens, engine)
    assert driven([among_people(5)], pens, engine).rows == [together.rows[5]]
