"""Several robots in a world: the same rows alone and among others, what they meet, and worlds that are too small."""

from collections.abc import Sequence

import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk.chunk_placement import place_chunk, worlds_shared
from tasks.simulate.chunk.robot_starts import APART_M
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import ENDLESS, FOLDERS, PLAIN, PUSHER, delivery, hall, pushing, simulate_lanes

ROBOTS, WORLDS, LANES = 3, 4, 12
COUNTING = PUSHER.model_copy(update={"digest": PLAIN, "package": "plain", "launch_file": "counting"})


def sharing(alone: EpisodeRequest, robots: int = ROBOTS) -> list[EpisodeRequest]:
    return [
        alone.model_copy(update={"index": alone.index + number, "robots": robots, "number": number})
        for number in range(robots)
    ]


def pens_shared(worlds: int = WORLDS) -> list[EpisodeRequest]:
    asked = [pushing(ROBOTS * k, world=f"hand/pen-{k % 3}", seed=k, duration_s=12.0) for k in range(worlds)]
    return [each for alone in asked for each in sharing(alone)]


def driven(
    requests: Sequence[EpisodeRequest], worlds: dict[str, World], lanes: int = LANES, recorder: Recorder | None = None
) -> list[EpisodeResult]:
    return [
        row
        for chunk in plan_chunks(requests, lanes)
        for row in simulate_lanes(chunk, worlds, FOLDERS, lanes=lanes, should_stop=lambda: False, recorder=recorder)
    ]


@pytest.fixture(scope="module")
def together(pens: dict[str, World]) -> list[EpisodeResult]:
    return driven(pens_shared(), pens)


def test_robots_of_a_world_have_the_rows_alone_that_they_have_among_others(
    pens: dict[str, World], together: list[EpisodeResult]
):
    assert driven(pens_shared()[2 * ROBOTS : 3 * ROBOTS], pens) == together[2 * ROBOTS : 3 * ROBOTS]


def test_rows_do_not_hang_on_how_many_lanes_there_are(pens: dict[str, World], together: list[EpisodeResult]):
    assert driven(pens_shared(), pens, lanes=ROBOTS) == together


def test_robots_that_end_together_came_as_near_to_each_other_as_the_other_says(together: list[EpisodeResult]):
    for first in range(0, len(together), ROBOTS):
        nearest_m = sorted(max(row.min_robot_m or 0.0, 0.0) for row in together[first : first + ROBOTS])
        assert nearest_m[0] == nearest_m[1]
    assert len({row.final_x_m for row in together}) == len(together)


def test_robots_that_do_not_look_run_into_each_other(together: list[EpisodeResult]):
    met = [row for row in together if row.robot_contacts]
    assert met
    for row in met:
        assert row.robot_contact_m_s is not None
        assert row.robot_contact_m_s > 0.0
        assert row.min_robot_m is not None
        assert row.min_robot_m < 0.0
        assert row.impulse_ns > 0.0


def test_a_robot_alone_says_nothing_of_others(pens: dict[str, World]):
    (row,) = driven([pushing(0, world="hand/pen-0")], pens)
    assert (row.robot_contacts, row.robot_contact_m_s, row.min_robot_m) == (None, None, None)


def test_the_first_robot_begins_where_it_begins_alone_and_all_apart(apartments: dict[str, World]):
    alone = delivery(0, world="hand/apartment-0", seed=5)
    placed = place_chunk(sharing(alone, 4), apartments, FOLDERS, lanes=LANES)
    ((first, *others),) = placed.parts
    ((single,),) = place_chunk([alone], apartments, FOLDERS, lanes=LANES).parts
    np.testing.assert_array_equal(first.placement.start, single.placement.start)
    np.testing.assert_array_equal(first.placement.goals_m, single.placement.goals_m)
    least_m = 2 * placed.program.hull.radius_m + APART_M
    for number, lane in enumerate(others, 1):
        for before in placed.parts[0][:number]:
            for ours, theirs in (
                (lane.placement.start[:2], before.placement.start[:2]),
                (lane.placement.goals_m[-1], before.placement.goals_m[-1]),
            ):
                assert np.hypot(*(ours - theirs)) >= least_m


def test_a_world_without_room_for_all_fails_all_its_robots():
    full = sharing(pushing(0, world="hand/hall", duration_s=12.0), 20)
    rows = driven(full, {"hand/hall": hall(0.35)}, lanes=20)
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InvalidInput")}
    assert all("robots: 20: hall has room for" in row.failure_reason for row in rows)


def test_robots_that_are_not_all_there_are_a_defect():
    with pytest.raises(ValueError, match="not all of its 3 robots"):
        worlds_shared(pens_shared()[:2])


def test_a_controller_in_plain_python_meets_others_as_one_that_is_compiled(pens: dict[str, World]):
    asked = [each.model_copy(update={"robot": COUNTING}) for each in pens_shared(2)]
    rows = driven(asked, pens)
    assert driven(asked[ROBOTS:], pens) == rows[ROBOTS:]
    assert all(row.robot_contacts is not None for row in rows)
    for first in range(0, len(rows), ROBOTS):
        nearest_m = sorted(max(row.min_robot_m or 0.0, 0.0) for row in rows[first : first + ROBOTS])
        assert nearest_m[0] == nearest_m[1]


def test_couriers_before_each_other_in_a_narrow_way_are_in_a_deadlock():
    narrow = {"hand/hall": hall(0.35)}
    asked = [each for k in range(4) for each in sharing(delivery(2 * k, world="hand/hall", seed=k, duration_s=60.0), 2)]
    rows = driven(asked, narrow, lanes=8)
    reasons = {row.outcome_reason for row in rows}
    assert "deadlock" in reasons, [(row.outcome_reason, row.failure_reason) for row in rows]
    for row in rows:
        if row.outcome_reason == "deadlock":
            assert row.min_robot_m is not None
            assert row.min_robot_m < 0.5


def test_a_recording_has_the_others_where_their_own_have_them(pens: dict[str, World]):
    recorder = Recorder(20.0, lambda _: True)
    driven(pens_shared(1), pens, recorder=recorder)
    (samples,) = recorder.parts()
    own = [samples["pose"][samples["index"] == number, :2] for number in range(ROBOTS)]
    for number in range(ROBOTS):
        seen = samples["robots_m"][samples["index"] == number]
        others = [each for other, each in enumerate(own) if other != number]
        np.testing.assert_array_equal(seen, np.stack(others, axis=1))


FACING = ENDLESS.model_copy(update={"launch_file": "facing"})


def facing(robots: int, apart_m: str) -> list[EpisodeRequest]:
    asked = pushing(0, world="hand/hall", duration_s=5.0)
    own = {"scenario": FACING, "environment": {"FAULT": "0", "APART": apart_m}}
    return sharing(asked.model_copy(update=own), robots)


def test_robots_begin_where_their_scenario_puts_all_of_them_and_end_in_each_other():
    rows = driven(facing(2, "0.8"), {"hand/hall": hall(2.0)})
    assert [row.outcome_reason for row in rows] == ["robot", "robot"]
    assert {row.robot_contacts for row in rows} == {1}
    assert {row.collisions for row in rows} == {0}
    assert all(row.robot_contact_m_s == pytest.approx(rows[0].robot_contact_m_s) for row in rows)
    assert rows[0].robot_contact_m_s is not None
    assert 0.2 < rows[0].robot_contact_m_s < 0.9
    assert rows[0].simulated_s == rows[1].simulated_s


def test_a_scenario_that_puts_robots_into_one_another_fails_them():
    rows = driven(facing(2, "0.1"), {"hand/hall": hall(2.0)})
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InvalidInput")}
    assert all("number 1 begins in another" in row.failure_reason for row in rows)


def test_robots_of_a_world_do_not_all_have_the_goals_of_one():
    asked = [
        each.model_copy(update={"environment": {**each.environment, "goals.x1_share": "0.5"}})
        for each in facing(2, "0.8")
    ]
    rows = driven(asked, {"hand/hall": hall(2.0)})
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InvalidInput")}
    assert all("each robot has goals of its own" in row.failure_reason for row in rows)


@pytest.mark.parametrize("name", ["start.x_share", "start.yaw_rad"])
def test_robots_that_their_scenario_puts_do_not_begin_elsewhere_in_silence(name: str):
    asked = facing(2, "0.8")
    moved = [each.model_copy(update={"environment": {**each.environment, name: "0.5"}}) for each in asked]
    rows = driven(moved, {"hand/hall": hall(2.0)})
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "InvalidInput")}
    assert all("scenario.place_robots says where all of them begin" in row.failure_reason for row in rows)
