"""Failure is data: whatever goes wrong in one episode is its row, and the others are the same bits without it."""

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tests.factories.simulations import delivery, pushing
from tests.simulate.conftest import Simulate

SOUND, NOT_FINITE, TOO_STRONG = "0", "1", "2"


@pytest.fixture(scope="module")
def sound(push: Simulate) -> list[EpisodeResult]:
    return push([pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(6)])


def with_fault(position: int, fault: str) -> list[EpisodeRequest]:
    faults = [fault if k == position else SOUND for k in range(6)]
    return [pushing(k, world=f"hand/pen-{k % 3}", seed=k, fault=faults[k]) for k in range(6)]


@pytest.mark.parametrize(
    ("fault", "code"), [(NOT_FINITE, "RobotApplicationCrash"), (TOO_STRONG, "SimulationApplicationCrash")]
)
def test_a_lane_that_blows_up_fails_alone(push: Simulate, sound: list[EpisodeResult], fault: str, code: str):
    rows = push(with_fault(2, fault))
    broken = rows.pop(2)
    assert (broken.status, broken.failure_code, broken.outcome_reason) == ("Failed", code, "crash")
    assert "finite" in broken.failure_reason
    assert broken.simulated_s == pytest.approx(1.05, abs=0.051)
    assert rows == [row for row in sound if row.index != 2]


def test_time_running_out_is_a_completed_job_whose_task_failed(sound: list[EpisodeResult]):
    assert {(row.status, row.outcome, row.outcome_reason) for row in sound} == {("Completed", "Failed", "timeout")}
    assert {row.simulated_s for row in sound} == {3.0}


def test_lanes_end_each_at_their_own_duration(push: Simulate):
    rows = push([pushing(k, world="hand/pen-0", duration_s=1.0 + 0.35 * k) for k in range(5)])
    assert [row.simulated_s for row in rows] == pytest.approx([1.0, 1.35, 1.7, 2.05, 2.4])


def test_the_trajectory_of_a_failed_episode_leads_from_start_to_end(sound: list[EpisodeResult]):
    for row in sound:
        assert [pose[0] for pose in row.trajectory] == pytest.approx([0.5 * k for k in range(7)])
        assert row.trajectory[-1][1:] == (row.final_x_m, row.final_y_m, row.final_yaw_rad)


def test_a_missing_world_is_a_row_and_the_others_run(push: Simulate, sound: list[EpisodeResult]):
    rows = push([pushing(0, world="hand/lost"), *(pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(1, 6))])
    assert (rows[0].status, rows[0].failure_code) == ("Failed", "InvalidS3Resource")
    assert "hand/lost" in rows[0].failure_reason
    assert rows[1:] == sound[1:]


def test_a_scenario_that_raises_in_one_world_fails_there_alone(
    push: Simulate, sound: list[EpisodeResult], pens: dict[str, World]
):
    cursed = {**pens, "hand/cursed": pens["hand/pen-0"].model_copy(update={"name": "cursed"})}
    requests = [pushing(0, world="hand/cursed"), *(pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(1, 6))]
    rows = push(requests, worlds=cursed)
    assert (rows[0].status, rows[0].failure_code) == ("Failed", "SimulationApplicationCrash")
    assert "ValueError: nobody starts here" in rows[0].failure_reason
    assert rows[1:] == sound[1:]


@pytest.mark.parametrize(
    ("launch", "reason"),
    [
        ("unimportable", "a_library_that_nobody_has"),
        (
            "raising",
            "controller.step: RuntimeError: no idea where to go "
            '(faulty/raising.py, line 13: raise RuntimeError("no idea where to go"))',
        ),
        ("growing", "state of another form"),
        ("absent", "ModuleNotFoundError"),
    ],
)
def test_a_broken_controller_fails_its_episodes_and_no_batch(push: Simulate, launch: str, reason: str):
    rows = push([pushing(k, world="hand/pen-0", launch=launch) for k in range(2)])
    assert {(row.status, row.failure_code) for row in rows} == {("Failed", "RobotApplicationCrash")}
    assert all(reason in row.failure_reason for row in rows)


def test_a_variable_that_the_controller_refuses_fails_the_episode(deliver: Simulate):
    row = deliver([delivery(0, world="hand/apartment-0", speed="fast")])[0]
    assert (row.status, row.failure_code) == ("Failed", "RobotApplicationCrash")
    assert "MAX_SPEED: 'fast'" in row.failure_reason


def test_what_is_stopped_is_canceled_and_not_half_reported(push: Simulate):
    asked: list[None] = []

    def after_two_slices() -> bool:
        asked.append(None)
        return len(asked) > 2

    rows = push(
        [pushing(0, world="hand/pen-0", duration_s=1.0), pushing(1, world="hand/pen-0", duration_s=60.0)],
        should_stop=after_two_slices,
    )
    assert [(row.status, row.simulated_s) for row in rows] == [("Completed", 1.0), ("Canceled", 0.0)]
