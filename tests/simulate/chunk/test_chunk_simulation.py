"""Whole episodes of the shipped courier and delivery, and what their rows say."""

import logging

import jax
import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tests.factories.simulations import FOLDERS, delivery, pen, pushing, simulate_lanes
from tests.factories.worlds import PAINT, box
from tests.simulate.conftest import LANES, PUSHER_LANES, Simulate

GOALS = 2
COMPILED = "Finished XLA compilation"


@pytest.fixture(scope="module")
def rows(deliver: Simulate) -> list[EpisodeResult]:
    return deliver([delivery(k, world=f"hand/apartment-{k % 4}", seed=100 + k) for k in range(LANES)])


@pytest.mark.long
def test_the_courier_delivers_in_cluttered_apartments(rows: list[EpisodeResult]):
    assert sum(row.outcome == "Passed" for row in rows) >= LANES - 1


def test_rows_come_in_the_order_of_the_requests(rows: list[EpisodeResult]):
    assert [row.index for row in rows] == list(range(LANES))


def test_what_is_passed_reached_all_goals_and_hit_nothing(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert (row.status, row.failure_code, row.outcome_reason) == ("Completed", "", "")
        assert row.goals_reached == row.goals_total == GOALS
        assert row.simulated_s < 60.0
        assert row.min_clearance_m > 0.0
        assert row.trajectory == ()


def test_a_path_is_longer_than_the_shortest_by_what_spl_says(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert row.shortest_path_m is not None
        assert row.shortest_path_m < row.path_length_m < 1.5 * row.shortest_path_m
        assert row.spl == row.shortest_path_m / row.path_length_m


def test_goals_are_reached_one_after_the_other(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        first, last = row.goal_times_s
        assert 0.0 < first < last == row.simulated_s


def test_a_robot_that_touches_nothing_gets_no_impulse(rows: list[EpisodeResult]):
    for row in rows:
        assert (row.impulse_ns == 0.0) == (row.max_impulse_ns == 0.0) == (row.collisions == 0)
        assert row.max_impulse_ns <= row.impulse_ns


@pytest.mark.long
def test_episodes_with_more_goals_run_beside_those_with_fewer(deliver: Simulate, rows: list[EpisodeResult]):
    mixed = [
        delivery(k, world="hand/apartment-0", seed=100, duration_s=2.0).model_copy(
            update={"environment": {"MAX_SPEED": "0.6", "GOALS": goals}}
        )
        for k, goals in enumerate(["2", "3", "2"])
    ]
    found = deliver(mixed)
    assert [row.goals_total for row in found] == [2, 3, 2]
    assert found[0].model_copy(update={"index": 2}) == found[2]
    assert found[0] == deliver(mixed[:1])[0]


def test_a_delivery_to_other_rooms_enters_them(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert row.rooms_entered == ("Living room", "Kitchen")
        assert (row.rooms_total, row.rooms_unreachable) == (2, ())
        assert row.goals_reachable == GOALS


def test_a_delivery_behind_a_shut_door_stays_in_its_room(deliver: Simulate, apartments: dict[str, World]):
    world = apartments["hand/apartment-0"]
    leaf = box("leaf", (2.5, 0.05, 0.0), (2.6, 0.95, 2.0), PAINT)
    shut = {"hand/shut": world.model_copy(update={"walls": (*world.walls, leaf)})}
    (row,) = deliver([delivery(0, world="hand/shut", seed=100)], shut)
    assert row.outcome == "Passed"
    assert (row.rooms_entered, row.rooms_unreachable) == (("Living room",), ("Kitchen",))


def test_driving_costs_energy(rows: list[EpisodeResult]):
    # 2 kg brought to 0.6 m/s hold 0.36 J.
    assert all(row.energy_j > 0.3 for row in rows)


def test_another_world_compiles_nothing(
    deliver: Simulate, apartments: dict[str, World], rows: list[EpisodeResult], caplog: pytest.LogCaptureFixture
):
    worlds = {**apartments, "hand/another": apartments["hand/apartment-0"]}
    with jax.log_compiles(), caplog.at_level(logging.WARNING, logger="jax"):
        again = deliver([delivery(0, world="hand/another", seed=100)], worlds=worlds)
        compiled = [record.message for record in caplog.records if COMPILED in record.message]
        jax.jit(lambda x: 3 * x)(1.0)
    assert again == rows[:1]
    assert not compiled
    assert any(COMPILED in record.message for record in caplog.records)  # JAX still says so in these words


def test_numbers_of_rows_are_finite(rows: list[EpisodeResult]):
    for row in rows:
        numbers = [value for value in row.model_dump().values() if isinstance(value, float)]
        assert np.isfinite(numbers).all()


def test_progress_counts_the_episodes_that_are_done(pens: dict[str, World]):
    told: list[int] = []
    chunk = Chunk(number=0, requests=(pushing(0, world="hand/pen-0", duration_s=1.0), pushing(1, world="hand/pen-0")))
    simulate_lanes(chunk, pens, FOLDERS, lanes=PUSHER_LANES, should_stop=lambda: False, progress=told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (1, 2)


REQUESTS = [
    delivery(k, world=f"hand/apartment-{k % 4}", seed=k // 4, speed=("0.4", "0.7")[k % 2], duration_s=40.0)
    for k in range(LANES)
]

PUSHES = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=6.0) for k in range(256)]


@pytest.fixture(scope="module")
def together(deliver: Simulate) -> list[EpisodeResult]:
    return deliver(REQUESTS)


def test_a_rerun_gives_the_same_bits(deliver: Simulate, together: list[EpisodeResult]):
    assert deliver(REQUESTS) == together


@pytest.mark.parametrize("position", [0, 13, 31])
def test_a_lane_alone_is_the_lane_in_a_batch(deliver: Simulate, together: list[EpisodeResult], position: int):
    assert deliver([REQUESTS[position]]) == [together[position]]


def test_the_order_of_lanes_and_worlds_does_not_matter(
    deliver: Simulate, together: list[EpisodeResult], apartments: dict[str, World]
):
    backwards = dict(reversed(apartments.items()))
    assert deliver(REQUESTS[::-1], worlds=backwards) == together[::-1]


def test_a_sweep_over_numbers_reaches_each_lane(together: list[EpisodeResult]):
    slow = [row.path_length_m / row.simulated_s for row in together[::2]]
    fast = [row.path_length_m / row.simulated_s for row in together[1::2]]
    assert max(slow) <= 0.4 < min(fast) <= max(fast) <= 0.7


@pytest.fixture(scope="module", params=["planar", "mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def large(request: pytest.FixtureRequest, pens: dict[str, World]) -> tuple[str, list[EpisodeResult]]:
    """A batch of 256 robots that push on blindly, on each engine."""
    (chunk,) = plan_chunks(PUSHES, len(PUSHES))
    return request.param, simulate_lanes(
        chunk, pens, FOLDERS, lanes=len(PUSHES), engine=request.param, should_stop=lambda: False
    )


@pytest.mark.long
def test_a_batch_of_one_is_the_lane_in_a_batch_of_256(large: tuple[str, list[EpisodeResult]], pens: dict[str, World]):
    engine, rows = large
    assert sum(row.collisions > 0 for row in rows[::17]) >= 8
    for position in range(0, len(PUSHES), 17):
        (chunk,) = plan_chunks([PUSHES[position]], 1)
        alone = simulate_lanes(chunk, pens, FOLDERS, lanes=1, engine=engine, should_stop=lambda: False)
        assert alone == [rows[position]]


@pytest.mark.long
@pytest.mark.parametrize("engine", ["planar", "mujoco"])
def test_where_in_a_large_batch_a_lane_lies_does_not_matter(engine: str):
    requests = [delivery(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=5.0) for k in range(128)]
    worlds = {f"hand/pen-{k}": pen(6.0, k) for k in range(3)}
    order = np.random.default_rng(0).permutation(len(requests)).tolist()

    def run(requests: list[EpisodeRequest]) -> list[EpisodeResult]:
        (chunk,) = plan_chunks(requests, 128)
        return simulate_lanes(chunk, worlds, FOLDERS, lanes=128, engine=engine, should_stop=lambda: False)

    in_order = run(requests)
    assert run([requests[k] for k in order]) == [in_order[k] for k in order]


@pytest.mark.long
def test_a_larger_world_in_the_chunk_changes_no_bit_of_a_lane():
    small, large = delivery(0, world="hand/small", seed=3, duration_s=8.0), delivery(1, world="hand/large", seed=3)
    worlds = {"hand/small": pen(6.0, 1), "hand/large": pen(30.0, 2)}

    def run(*requests: EpisodeRequest) -> EpisodeResult:
        (chunk,) = plan_chunks(requests, 8)
        return simulate_lanes(chunk, worlds, FOLDERS, lanes=8, should_stop=lambda: False)[0]

    present = {name: worlds[name] for name in ("hand/small",)}
    (alone,) = plan_chunks([small], 8)
    assert simulate_lanes(alone, present, FOLDERS, lanes=8, should_stop=lambda: False) == [run(small, large)]


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
