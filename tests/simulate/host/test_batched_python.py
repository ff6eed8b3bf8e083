"""One controller for all lanes: it keeps their state; a lane's NaN is its own crash, an exception is all lanes'."""

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk, plan_chunks
from tasks.simulate.sandbox.sandbox_client import retry_with_fewer_lanes
from tests.factories.simulations import FOLDERS, PLAIN, pushing, simulate_lanes

SOUND, NO_NUMBER, RAISING, MISSHAPEN, UNMADE, UNSET = "012345"
TOGETHER = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="together")
LANES = 16


def moving(index: int, fault: str, duration_s: float) -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, fault=fault, duration_s=duration_s)
    return drawn.model_copy(update={"robot": TOGETHER})


def run(faults: list[str], pens: dict[str, World], first: int = 0) -> list[EpisodeResult]:
    requests = [moving(index, fault, 2.0 + 0.2 * (index % 3)) for index, fault in enumerate(faults, first)]
    (chunk,) = plan_chunks(requests, LANES)
    return simulate_lanes(chunk, pens, FOLDERS, lanes=LANES, should_stop=lambda: False)


@pytest.fixture(scope="module")
def sound(pens: dict[str, World]) -> list[EpisodeResult]:
    return run([SOUND] * LANES, pens)


def test_it_drives_on_the_fastest_engine(sound: list[EpisodeResult]):
    assert {(row.status, row.outcome_reason, row.engine) for row in sound} == {("Completed", "timeout", "planar")}
    assert {row.simulated_s for row in sound} == {2.0, 2.2, 2.4}
    assert all(row.path_length_m > 0.1 for row in sound)


def test_a_rerun_gives_the_same_bits(sound: list[EpisodeResult], pens: dict[str, World]):
    assert run([SOUND] * LANES, pens) == sound


@pytest.mark.parametrize("others", [1, 5])
def test_a_row_does_not_depend_on_how_many_lanes_hold_episodes(
    sound: list[EpisodeResult], pens: dict[str, World], others: int
):
    assert run([SOUND] * others, pens, first=7) == sound[7 : 7 + others]


def test_a_lanes_answer_that_is_no_number_is_its_own_crash(sound: list[EpisodeResult], pens: dict[str, World]):
    rows = run([NO_NUMBER if index == 3 else SOUND for index in range(LANES)], pens)
    broken = rows.pop(3)
    assert (broken.status, broken.simulated_s) == ("Failed", 1.0)
    assert broken.failure_reason == "controller.step: returned a control that is not finite"
    assert rows == [row for row in sound if row.index != 3]


@pytest.mark.parametrize(
    ("fault", "reason", "simulated_s"),
    [
        (
            RAISING,
            "controllers.step: RuntimeError: tired of this "
            '(plain/together.py, line 39: raise RuntimeError("tired of this"))',
            1.0,
        ),
        (MISSHAPEN, "controllers.step: control of shape (", 1.0),
        (UNSET, "controllers.reset: RuntimeError: no idea where to go", 0.0),
    ],
)
def test_what_it_raises_is_the_row_of_all_lanes_that_move(
    pens: dict[str, World], fault: str, reason: str, simulated_s: float
):
    rows = run([SOUND, SOUND, fault], pens)
    assert {(row.status, row.failure_code, row.simulated_s) for row in rows} == {
        ("Failed", "RobotApplicationCrash", simulated_s)
    }
    assert all(row.failure_reason.startswith(reason) for row in rows)


def test_what_cannot_be_made_says_so(pens: dict[str, World]):
    (row,) = run([UNMADE], pens)
    assert "ValueError: nobody makes us (plain/together.py, line " in row.failure_reason


@pytest.mark.long
def test_a_chunk_that_runs_in_parts_has_the_same_rows(sound: list[EpisodeResult], pens: dict[str, World]):
    requests = [moving(index, SOUND, 2.0 + 0.2 * (index % 3)) for index in range(4 * LANES)]
    (chunk,) = plan_chunks(requests, 4 * LANES)

    def simulate(part: Chunk, lanes: int) -> list[EpisodeResult]:
        if lanes > LANES:
            raise MemoryError("too many lanes")
        return simulate_lanes(part, pens, FOLDERS, lanes=lanes, should_stop=lambda: False)

    whole = simulate_lanes(chunk, pens, FOLDERS, lanes=4 * LANES, should_stop=lambda: False)
    rows, lanes = retry_with_fewer_lanes(chunk, 4 * LANES, simulate, lambda: False)
    assert (list(rows), lanes) == (whole, LANES)
    assert whole[:LANES] == sound
