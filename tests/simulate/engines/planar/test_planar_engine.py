"""A lane's motion depends on the lane alone, bit for bit, whatever runs beside it."""

import jax
import numpy as np
import pytest

from tasks.simulate.application.contract import Motion
from tasks.simulate.engines.planar.planar_robot import PlanarRobot
from tests.factories.planar import ROUGH, Obstacles, box, drive_planar, padded, read, write_robot

pytestmark = pytest.mark.long

LANES = 24
STEPS = 30
CLUTTER = Obstacles(
    np.array([box(0.45, 0.1, 0.1, 0.3, yaw=0.4), box(-0.4, -0.2, 0.1, 0.4, yaw=-0.7)]),
    np.array([[0.1, -0.5, 0.5, 0.12, 0.5], [0.0, 0.55, 0.5, 0.2, 0.5]]),
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> PlanarRobot:
    return read(write_robot(tmp_path_factory.mktemp("robot"), {**ROUGH, "x/frictionloss": "0.3"}))


def told(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-1.0, 1.0, (LANES, 3)) * [0.1, 0.1, 3.0]
    return starts, rng.uniform(-1.0, 1.0, (STEPS, LANES, 3)) * [1.0, 2.0, 0.1]


def run(robot: PlanarRobot, starts: np.ndarray, controls: np.ndarray) -> Motion:
    lanes = len(starts)
    around = Obstacles(*(np.tile(each, (lanes, 1, 1)) for each in padded(CLUTTER)))
    return drive_planar(robot, around, starts, controls)


@pytest.fixture(scope="module")
def together(robot: PlanarRobot) -> Motion:
    return run(robot, *told())


def assert_same_bits(one: Motion, other: Motion) -> None:
    jax.tree.map(np.testing.assert_array_equal, one, other)


def test_lanes_collide(together: Motion):
    assert (together.work.impulse_ns.max(axis=0) > 0).mean() > 0.5


@pytest.mark.long
def test_eight_lanes_move_as_they_do_among_others(robot: PlanarRobot, together: Motion):
    starts, controls = told()
    alone = run(robot, starts[8:16], controls[:, 8:16])
    assert_same_bits(alone, jax.tree.map(lambda array: array[:, 8:16], together))


def test_a_lanes_place_does_not_matter(robot: PlanarRobot, together: Motion):
    starts, controls = told()
    backwards = run(robot, starts[::-1], controls[:, ::-1])
    assert_same_bits(jax.tree.map(lambda array: array[:, ::-1], backwards), together)


@pytest.mark.parametrize("broken", ["start", "control"])
def test_a_lane_that_is_not_a_number_leaves_the_others_alone(robot: PlanarRobot, together: Motion, broken: str):
    starts, controls = told()
    if broken == "start":
        starts[5, 0] = np.nan
    else:
        controls[3:, 5, 0] = np.nan
    beside = run(robot, starts, controls)
    assert np.isnan(beside.body.qpos[-1, 5]).any()
    others = np.arange(LANES) != 5
    assert_same_bits(*(jax.tree.map(lambda array: array[:, others], each) for each in (beside, together)))


def test_a_rerun_gives_the_same_bits(robot: PlanarRobot, together: Motion):
    assert_same_bits(run(robot, *told()), together)
