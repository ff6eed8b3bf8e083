"""Controllers in plain Python: each lane has its own, and what one raises is its lane's row."""

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox.sandbox_client import retry_with_fewer_lanes
from tests.factories.simulations import FOLDERS, PLAIN, pushing, simulate_lanes

SOUND, RAISING, MISSHAPEN, LATE_RAISING, UNMADE = "0", "1", "2", "3", "4"
COUNTER = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="counting")
LANES = 6


def counting(index: int, fault: str) -> EpisodeRequest:
    return pushing(index, world="hand/pen-0", seed=index, fault=fault).model_copy(update={"robot": COUNTER})


def run(faults: list[str], pens: dict[str, World], engine: str = "auto") -> list[EpisodeResult]:
    (chunk,) = plan_chunks([counting(index, fault) for index, fault in enumerate(faults)], LANES)
    return simulate_lanes(chunk, pens, FOLDERS, lanes=LANES, engine=engine, should_stop=lambda: False)


@pytest.fixture(scope="module")
def sound(pens: dict[str, World]) -> list[EpisodeResult]:
    return run([SOUND] * LANES, pens)


def test_it_drives(sound: list[EpisodeResult]):
    assert {(row.status, row.outcome_reason, row.simulated_s) for row in sound} == {("Completed", "timeout", 3.0)}
    assert all(row.path_length_m > 0.3 for row in sound)


def test_a_rerun_gives_the_same_bits(sound: list[EpisodeResult], pens: dict[str, World]):
    assert run([SOUND] * LANES, pens) == sound


@pytest.mark.parametrize(
    ("fault", "reason", "simulated_s"),
    [
        (
            UNMADE,
            "controller(environment): ValueError: nobody makes me "
            '(plain/counting.py, line 25: raise ValueError("nobody makes me"))',
            0.0,
        ),
        (
            RAISING,
            "controller.reset: RuntimeError: no idea where to go "
            '(plain/counting.py, line 33: raise RuntimeError("no idea where to go"))',
            0.0,
        ),
        (MISSHAPEN, "controller.step: control of shape (1,), not (3,)", 0.0),
        (
            LATE_RAISING,
            "controller.step: RuntimeError: tired of this "
            '(plain/counting.py, line 38: raise RuntimeError("tired of this"))',
            1.0,
        ),
    ],
)
def test_what_a_controller_raises_is_the_row_of_its_lane_alone(
    sound: list[EpisodeResult], pens: dict[str, World], fault: str, reason: str, simulated_s: float
):
    rows = run([SOUND, SOUND, fault, SOUND, SOUND, SOUND], pens)
    broken = rows.pop(2)
    assert (broken.status, broken.failure_code) == ("Failed", "RobotApplicationCrash")
    assert broken.failure_reason == reason
    assert broken.simulated_s == simulated_s
    assert rows == [row for row in sound if row.index != 2]


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("mjx", marks=pytest.mark.soak)])
def test_every_engine_runs_it(sound: list[EpisodeResult], pens: dict[str, World], engine: str):
    rows = run([SOUND] * LANES, pens, engine)
    assert {(row.status, row.engine) for row in rows} == {("Completed", engine)}
    assert {row.engine for row in sound} == {"planar"}
    near = [(row.final_x_m, row.final_y_m) for row in sound]
    assert [(row.final_x_m, row.final_y_m) for row in rows] == [pytest.approx(place, abs=0.02) for place in near]


@pytest.mark.parametrize("engine", ["auto", "mujoco"])
def test_its_commands_arrive_as_late_as_the_episode_says(pens: dict[str, World], engine: str):
    """It counts its steps and does not look: after 3 s with 0.5 s of delay its robot is where it was after 2.5 s."""
    plain = [counting(index, SOUND).model_copy(update={"duration_s": 2.5}) for index in range(LANES)]
    own = {"FAULT": SOUND, "robot.controlDelay_s": "0.5"}
    late = [counting(index, SOUND).model_copy(update={"environment": own}) for index in range(LANES)]
    found = [
        simulate_lanes(
            plan_chunks(some, LANES)[0], pens, FOLDERS, lanes=LANES, engine=engine, should_stop=lambda: False
        )
        for some in (plain, late)
    ]
    ends = [[(row.final_x_m, row.final_y_m, row.final_yaw_rad, row.energy_j) for row in rows] for rows in found]
    assert {row.simulated_s for row in found[1]} == {3.0}
    assert ends[0] == ends[1]


ALL_SOUND, NO_NUMBER, ALL_RAISING, ALL_MISSHAPEN, ALL_UNMADE, UNSET = "012345"
TOGETHER = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="together")
BATCHED_LANES = 16


def moving_together(index: int, fault: str, duration_s: float) -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, fault=fault, duration_s=duration_s)
    return drawn.model_copy(update={"robot": TOGETHER})


def run_batched(faults: list[str], pens: dict[str, World], first: int = 0) -> list[EpisodeResult]:
    requests = [moving_together(index, fault, 2.0 + 0.2 * (index % 3)) for index, fault in enumerate(faults, first)]
    (chunk,) = plan_chunks(requests, BATCHED_LANES)
    return simulate_lanes(chunk, pens, FOLDERS, lanes=BATCHED_LANES, should_stop=lambda: False)


@pytest.fixture(scope="module")
def sound_together(pens: dict[str, World]) -> list[EpisodeResult]:
    return run_batched([ALL_SOUND] * BATCHED_LANES, pens)


@pytest.mark.long
def test_it_drives_on_the_fastest_engine(sound_together: list[EpisodeResult]):
    assert {(row.status, row.outcome_reason, row.engine) for row in sound_together} == {
        ("Completed", "timeout", "planar")
    }
    assert {row.simulated_s for row in sound_together} == {2.0, 2.2, 2.4}
    assert all(row.path_length_m > 0.1 for row in sound_together)


@pytest.mark.long
def test_a_rerun_of_all_lanes_gives_the_same_bits(sound_together: list[EpisodeResult], pens: dict[str, World]):
    assert run_batched([ALL_SOUND] * BATCHED_LANES, pens) == sound_together


@pytest.mark.parametrize("others", [1, 5])
def test_a_row_does_not_depend_on_how_many_lanes_hold_episodes(
    sound_together: list[EpisodeResult], pens: dict[str, World], others: int
):
    assert run_batched([ALL_SOUND] * others, pens, first=7) == sound_together[7 : 7 + others]


def test_a_lanes_answer_that_is_no_number_is_its_own_crash(sound_together: list[EpisodeResult], pens: dict[str, World]):
    rows = run_batched([NO_NUMBER if index == 3 else ALL_SOUND for index in range(BATCHED_LANES)], pens)
    broken = rows.pop(3)
    assert (broken.status, broken.simulated_s) == ("Failed", 1.0)
    assert broken.failure_reason == "controller.step: returned a control that is not finite"
    assert rows == [row for row in sound_together if row.index != 3]


@pytest.mark.parametrize(
    ("fault", "reason", "simulated_s"),
    [
        (
            ALL_RAISING,
            "controllers.step: RuntimeError: tired of this "
            '(plain/together.py, line 39: raise RuntimeError("tired of this"))',
            1.0,
        ),
        (ALL_MISSHAPEN, "controllers.step: control of shape (", 1.0),
        (UNSET, "controllers.reset: RuntimeError: no idea where to go", 0.0),
    ],
)
def test_what_it_raises_is_the_row_of_all_lanes_that_move(
    pens: dict[str, World], fault: str, reason: str, simulated_s: float
):
    rows = run_batched([ALL_SOUND, ALL_SOUND, fault], pens)
    assert {(row.status, row.failure_code, row.simulated_s) for row in rows} == {
        ("Failed", "RobotApplicationCrash", simulated_s)
    }
    assert all(row.failure_reason.startswith(reason) for row in rows)


def test_what_cannot_be_made_says_so(pens: dict[str, World]):
    (row,) = run_batched([ALL_UNMADE], pens)
    assert "ValueError: nobody makes us (plain/together.py, line " in row.failure_reason


@pytest.mark.long
def test_a_chunk_that_runs_in_parts_has_the_same_rows(sound_together: list[EpisodeResult], pens: dict[str, World]):
    requests = [moving_together(index, ALL_SOUND, 2.0 + 0.2 * (index % 3)) for index in range(4 * BATCHED_LANES)]
    (chunk,) = plan_chunks(requests, 4 * BATCHED_LANES)

    def simulate(part: Chunk, lanes: int) -> list[EpisodeResult]:
        if lanes > BATCHED_LANES:
            raise MemoryError("too many lanes")
        return simulate_lanes(part, pens, FOLDERS, lanes=lanes, should_stop=lambda: False)

    whole = simulate_lanes(chunk, pens, FOLDERS, lanes=4 * BATCHED_LANES, should_stop=lambda: False)
    rows, lanes = retry_with_fewer_lanes(chunk, 4 * BATCHED_LANES, simulate, lambda: False)
    assert (list(rows), lanes) == (whole, BATCHED_LANES)
    assert whole[:BATCHED_LANES] == sound_together
