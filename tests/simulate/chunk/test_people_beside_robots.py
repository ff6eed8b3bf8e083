"""People beside several robots: all robots of a world have the same people, who mind each of them."""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.people import PERSON_RADIUS_M, People
from specs.data.world import World
from tasks.simulate.chunk.chunk_placement import place_chunk
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, PLAIN, PUSHER, delivery, hall, pen, pushing, simulate_lanes

ROBOTS, WORLDS, LANES, RATE_HZ = 3, 3, 9, 20.0
COUNTING = PUSHER.model_copy(update={"digest": PLAIN, "package": "plain", "launch_file": "counting"})
PEOPLE = People(count=3, unaware=0.5)
WIDE = {f"hand/pen-{seed}": pen(7.0, seed) for seed in range(WORLDS)}


def shared(alone: EpisodeRequest, people: People, robots: int = ROBOTS) -> list[EpisodeRequest]:
    several = {"robots": robots, "people": people}
    return [
        alone.model_copy(update={"index": alone.index + number, "number": number, **several})
        for number in range(robots)
    ]


def pushing_together() -> list[EpisodeRequest]:
    alone = [pushing(ROBOTS * k, world=f"hand/pen-{k}", seed=k, duration_s=12.0) for k in range(WORLDS)]
    return [each for one in alone for each in shared(one, PEOPLE)]


class Driven(NamedTuple):
    """Rows, and what was recorded of all their episodes."""

    rows: list[EpisodeResult]
    samples: Mapping[str, np.ndarray]

    def people_m(self, index: int) -> np.ndarray:
        """Returns where people were who are there, at the samples of a robot, until it was done."""
        return self.samples["people_m"][self.samples["index"] == index][:, : PEOPLE.count]


def driven(requests: Sequence[EpisodeRequest], worlds: dict[str, World], lanes: int = LANES) -> Driven:
    recorder = Recorder(RATE_HZ, lambda _: True)
    rows = [
        row
        for chunk in plan_chunks(requests, lanes)
        for row in simulate_lanes(chunk, worlds, FOLDERS, lanes=lanes, should_stop=lambda: False, recorder=recorder)
    ]
    (samples,) = recorder.parts()
    return Driven(rows, samples)


@pytest.fixture(scope="module")
def together() -> Driven:
    return driven(pushing_together(), WIDE)


def test_robots_among_people_have_the_rows_alone_that_they_have_among_others(together: Driven):
    alone = driven(pushing_together()[ROBOTS : 2 * ROBOTS], WIDE, lanes=ROBOTS)
    assert alone.rows == together.rows[ROBOTS : 2 * ROBOTS]


def test_rows_have_how_robots_met_people_and_one_another(together: Driven):
    assert any(row.person_contacts for row in together.rows)
    assert any(row.robot_contacts for row in together.rows)
    for row in together.rows:
        assert row.min_person_m is not None
        assert row.min_robot_m is not None


def with_one_people(drove: Driven) -> None:
    """Checks that robots which share a world have the same people, while they drive."""
    for first in range(0, len(drove.rows), ROBOTS):
        ways = sorted((drove.people_m(first + number) for number in range(ROBOTS)), key=len)
        assert np.ptp(ways[0], axis=0).max() > 0.5
        for shorter, longer in itertools.pairwise(ways):
            np.testing.assert_array_equal(longer[: len(shorter)], shorter)


def test_all_robots_of_a_world_have_the_same_people(together: Driven):
    with_one_people(together)


def test_people_walk_on_when_a_robot_of_their_world_is_done():
    alone = [delivery(ROBOTS * k, world="hand/hall", seed=k, duration_s=40.0) for k in range(2)]
    two = PEOPLE.model_copy(update={"count": 2})
    drove = driven([each for one in alone for each in shared(one, two)], {"hand/hall": hall(2.0)})
    assert {row.status for row in drove.rows} == {"Completed"}
    assert len({row.simulated_s for row in drove.rows}) > 2
    with_one_people(drove)


def test_people_begin_clear_of_all_robots_of_their_world():
    requests = pushing_together()[:ROBOTS]
    placed = place_chunk(requests, WIDE, FOLDERS, lanes=LANES)
    (lanes,) = placed.parts
    people = [lane.people for lane in lanes if lane.people is not None]
    assert len(people) == ROBOTS
    for lane in lanes:
        away_m = np.hypot(*(people[0].place_m[: PEOPLE.count] - lane.placement.start[:2]).T)
        assert away_m.min() >= placed.program.hull.radius_m + PERSON_RADIUS_M + 1.0
    for other in people[1:]:
        np.testing.assert_array_equal(other.place_m, people[0].place_m)


def test_a_controller_in_plain_python_among_people_and_robots_records_both():
    short = {"robot": COUNTING, "duration_s": 3.0}
    drove = driven([each.model_copy(update=short) for each in pushing_together()[:ROBOTS]], WIDE)
    with_one_people(drove)
    own = [drove.samples["pose"][drove.samples["index"] == number, :2] for number in range(ROBOTS)]
    others = drove.samples["robots_m"][drove.samples["index"] == 0]
    np.testing.assert_array_equal(others, np.stack(own[1:], axis=1))
    assert drove.samples["boxes_m"].shape[1] == 0


def test_a_world_without_room_for_people_fails_all_its_robots():
    full = [each.model_copy(update={"people": People(count=16)}) for each in pushing_together()[:ROBOTS]]
    chunk = plan_chunks(full, LANES)[0]
    rows = simulate_lanes(chunk, {"hand/pen-0": pen(3.0, 0)}, FOLDERS, lanes=LANES, should_stop=lambda: False)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InvalidInput")}
    assert all("people: 16: " in row.failure_reason for row in rows)
