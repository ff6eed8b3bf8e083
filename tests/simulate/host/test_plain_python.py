"""Controllers in plain Python: each lane has its own, and what one raises is its lane's row."""

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
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


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("mjx", marks=pytest.mark.long)])
def test_every_engine_runs_it(sound: list[EpisodeResult], pens: dict[str, World], engine: str):
    rows = run([SOUND] * LANES, pens, engine)
    assert {(row.status, row.engine) for row in rows} == {("Completed", engine)}
    assert {row.engine for row in sound} == {"planar"}
    near = [(row.final_x_m, row.final_y_m) for row in sound]
    assert [(row.final_x_m, row.final_y_m) for row in rows] == [pytest.approx(place, abs=0.02) for place in near]
