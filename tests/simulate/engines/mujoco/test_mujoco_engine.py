"""C MuJoCo as an engine: a lane is its own, whatever runs beside it and on however many threads."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.robot_model import no_log
from tasks.simulate.engines.mujoco.world_stepper import Stepper, host_robot, world_model, world_models
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FAULTY, FOLDERS, cluttered, pushing, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES
from tests.simulate.reference import replay

SOUND, NOT_FINITE, TOO_STRONG = "0", "1", "2"
LANES, STEPS = 6, 60
ROBOT = FOLDERS[FAULTY] / "robot.xml"


def run(requests: Sequence[EpisodeRequest], worlds: dict[str, World], lanes: int = PUSHER_LANES) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, lanes)
    return simulate_lanes(chunk, worlds, FOLDERS, lanes=lanes, engine="mujoco", should_stop=lambda: False)


@pytest.fixture(scope="module")
def requests() -> list[EpisodeRequest]:
    return [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=6.0) for k in range(LANES)]


@pytest.fixture(scope="module")
def together(requests: list[EpisodeRequest], pens: dict[str, World]) -> list[EpisodeResult]:
    return run(requests, pens)


def test_robots_bump_into_things(together: list[EpisodeResult]):
    assert sum(row.collisions > 0 for row in together) >= LANES // 2
    assert all(row.energy_j > 0.1 for row in together)


def test_rows_say_which_rooms_robots_were_in(together: list[EpisodeResult]):
    assert {(row.rooms_entered, row.rooms_total) for row in together} == {(("Living room",), 1)}


@pytest.mark.parametrize("position", [0, 4])
def test_a_lane_alone_is_the_lane_in_a_batch(
    requests: list[EpisodeRequest], together: list[EpisodeResult], pens: dict[str, World], position: int
):
    assert run([requests[position]], pens, lanes=3) == [together[position]]


def test_neither_order_nor_larger_worlds_matter(
    requests: list[EpisodeRequest], together: list[EpisodeResult], pens: dict[str, World]
):
    larger = pushing(LANES, world="hand/larger", seed=3, duration_s=1.0)
    rows = run([larger, *requests[::-1]], {"hand/larger": cluttered(9), **pens})
    assert rows[1:] == together[::-1]


@pytest.mark.parametrize(
    ("fault", "code"), [(NOT_FINITE, "RobotApplicationCrash"), (TOO_STRONG, "SimulationApplicationCrash")]
)
def test_a_lane_that_blows_up_fails_alone_and_writes_no_log(  # noqa: PLR0917 - fixtures
    together: list[EpisodeResult],
    requests: list[EpisodeRequest],
    pens: dict[str, World],
    fault: str,
    code: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    faulty = [
        request.model_copy(update={"environment": {"FAULT": fault if k == 2 else SOUND}})
        for k, request in enumerate(requests)
    ]
    rows = run(faulty, pens)
    broken = rows.pop(2)
    assert (broken.status, broken.failure_code, broken.outcome_reason) == ("Failed", code, "crash")
    assert broken.simulated_s == pytest.approx(1.05, abs=0.051)
    assert rows == [row for row in together if row.index != 2]
    assert list(tmp_path.iterdir()) == []


def paths(models: list[mujoco.MjModel], threads: int) -> np.ndarray:
    robot = host_robot(ROBOT)
    rng = np.random.default_rng(1)
    starts = np.stack([[*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3, 3)] for _ in models])
    controls = np.array([0.4, 0.0, 0.7])[None] * rng.uniform(0.5, 1.0, (len(models), 1))
    stepper = Stepper(robot, models, starts, threads)
    moving = np.ones(len(models), bool)
    return np.stack([stepper.drive(controls, moving)[0].qpos for _ in range(STEPS)])


@pytest.mark.parametrize("threads", [2, 4])
def test_the_number_of_threads_does_not_matter(pens: dict[str, World], threads: int):
    models = [*world_models(host_robot(ROBOT), pens).values()] * 3
    np.testing.assert_array_equal(paths(models, 1), paths(models, threads))


def test_a_robot_that_rests_stays_where_it_is(pens: dict[str, World]):
    model = world_model(host_robot(ROBOT), pens["hand/pen-0"])
    stepper = Stepper(host_robot(ROBOT), [model] * 2, np.zeros((2, 3)), 1)
    body, work = stepper.drive(np.full((2, 3), 0.5, np.float32), np.array([True, False]))
    assert body.qpos[0][0] > 0.0
    assert body.qpos[1].tolist() == body.qvel[1].tolist() == [0.0, 0.0, 0.0]
    assert (work.energy_j[0] > 0.0, work.energy_j[1]) == (True, 0.0)


def test_a_robot_is_pushed_back_from_what_it_drives_against(pens: dict[str, World]):
    model = world_model(host_robot(ROBOT), pens["hand/pen-0"])
    # The pen's eastern wall has its face at 2.2 m, the robot a radius of 0.2 m.
    stepper = Stepper(host_robot(ROBOT), [model], np.array([[1.99, 0.0, 0.0]]), 1)
    pushes = [stepper.drive(np.array([[0.4, 0.0, 0.0]]), np.ones(1, bool))[1] for _ in range(20)]
    assert stepper.body().qpos[0][0] < 2.02
    # Its motor pushes 10 N at most, 0.5 N s in a control step, once the bump is over.
    assert pushes[-1].push_ns[0] == pytest.approx([-0.5, 0.0], abs=0.02)
    assert pushes[-1].impulse_ns[0] == pytest.approx(0.5, abs=0.02)


def test_a_robot_is_pushed_back_from_a_person_wherever_that_stands(pens: dict[str, World]):
    robot, bare = host_robot(ROBOT), pens["hand/pen-0"].model_copy(update={"furniture": ()})
    stepper = Stepper(robot, [world_model(robot, bare, people=2)] * 2, np.zeros((2, 3)), 1)
    # One lane's second person stands in the way, the other one's stand aside.
    people_m = np.array([[[5.0, 5.0], [0.5, 0.0]], [[5.0, 5.0], [0.5, 1.0]]])
    given = np.tile([0.4, 0.0, 0.0], (2, 1)), np.ones(2, bool), people_m
    pushes = [stepper.drive(*given)[1] for _ in range(30)]
    stopped, free = stepper.body().qpos[:, 0]
    assert stopped < 0.07
    assert free > 0.4
    assert pushes[-1].people_ns == pytest.approx([0.5, 0.0], abs=0.02)
    assert pushes[-1].push_ns == pytest.approx(np.array([[-0.5, 0.0], [0.0, 0.0]]), abs=0.02)
    assert not any(push.impulse_ns.any() for push in pushes)


def test_it_drives_as_mujoco_does_step_by_step(pens: dict[str, World]):
    model = world_model(host_robot(ROBOT), pens["hand/pen-1"])
    rng = np.random.default_rng(5)
    start, controls = np.array([0.1, -0.2, 1.0]), rng.uniform(-0.5, 0.5, (STEPS, 1, 3)) * [1, 0.2, 2]
    stepper = Stepper(host_robot(ROBOT), [model], start[None], 1)
    ours = np.stack([stepper.drive(each, np.ones(1, bool))[0].qpos[0] for each in controls])
    np.testing.assert_allclose(ours, replay(model, start, controls[:, 0]), atol=1e-6)


def test_two_threads_that_step_share_who_hears_warnings_of_mujoco(monkeypatch: pytest.MonkeyPatch):
    heard: list[object] = []
    monkeypatch.setattr(mujoco, "set_mju_user_warning", heard.append)

    with no_log(), no_log():
        pass

    assert heard[-1] is None
    assert heard.count(None) == 1
