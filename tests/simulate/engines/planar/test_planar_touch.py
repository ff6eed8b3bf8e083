"""One robot and an obstacle or two: rest, slide, corner and wedge, each as C MuJoCo has them."""

from pathlib import Path

import numpy as np
import pytest

from tests.factories.planar import (
    CAPSULE,
    DRUM,
    MOTORS,
    NO_BOXES,
    NO_CYLINDERS,
    ROUGH,
    Obstacles,
    Parts,
    both,
    box,
    write_robot,
)

pytestmark = pytest.mark.long

SECONDS_2 = 40
WALL = Obstacles(np.array([box(0.6, 0.0, 0.1, 2.0)]), NO_CYLINDERS)
CORNER = Obstacles(np.array([box(0.6, 0.35, 0.15, 0.25, yaw=0.3)]), NO_CYLINDERS)
POST = Obstacles(NO_BOXES, np.array([[0.6, 0.05, 0.5, 0.12, 0.5]]))
WEDGE = Obstacles(np.array([box(0.55, 0.3, 0.4, 0.1, yaw=-0.5), box(0.55, -0.3, 0.4, 0.1, yaw=0.6)]), NO_CYLINDERS)
# Metres, and metres or radians a second.
PLACE_M, RATE = 2e-6, 2e-5


def ahead(speed: float, turn: float = 0.0) -> np.ndarray:
    """Returns two seconds of the same control."""
    return np.tile([speed, turn, 0.0], (SECONDS_2, 1))


@pytest.mark.parametrize("parts", [{}, ROUGH], ids=["smooth", "rough"])
@pytest.mark.parametrize(
    ("obstacles", "control"),
    [
        pytest.param(WALL, ahead(0.8), id="head on into a wall"),
        pytest.param(WALL, ahead(0.8, 0.9), id="along a wall"),
        pytest.param(CORNER, ahead(0.7), id="past a corner"),
        pytest.param(POST, ahead(0.7), id="round a post"),
        pytest.param(WEDGE, ahead(0.8), id="into a wedge"),
    ],
)
def test_a_robot_moves_as_in_c(tmp_path: Path, parts: Parts, obstacles: Obstacles, control: np.ndarray):
    motion, theirs = both(write_robot(tmp_path, parts), obstacles, [0.0, 0.0, 0.1], control)
    assert motion.work.impulse_ns.max() > 0.01
    np.testing.assert_allclose(motion.body.qpos, theirs.pose, atol=PLACE_M)
    np.testing.assert_allclose(motion.body.qvel, theirs.velocity, atol=RATE)


@pytest.mark.parametrize("parts", [DRUM, {**DRUM, **ROUGH}], ids=["smooth", "rough"])
@pytest.mark.parametrize(
    ("obstacles", "control", "off_m"),
    [
        pytest.param(WALL, ahead(0.8), 2e-6, id="head on into a wall"),
        pytest.param(WALL, ahead(0.8, 0.9), 1e-5, id="along a wall"),
        # C's normals are off by a thousandth between two cylinders.
        pytest.param(POST, ahead(0.7), 2e-3, id="round a post"),
    ],
)
def test_an_upright_cylinder_moves_as_in_c(
    tmp_path: Path, parts: Parts, obstacles: Obstacles, control: np.ndarray, off_m: float
):
    motion, theirs = both(write_robot(tmp_path, parts), obstacles, [0.0, 0.0, 0.1], control)
    assert motion.work.impulse_ns.max() > 0.01
    np.testing.assert_allclose(motion.body.qpos[:, :2], theirs.pose[:, :2], atol=off_m)


@pytest.mark.parametrize("obstacles", [CORNER, WEDGE], ids=["corner", "wedge"])
def test_at_corners_an_upright_cylinder_moves_as_a_capsule_does_in_c(tmp_path: Path, obstacles: Obstacles):
    """C turns a cylinder's normals at corners by up to a right angle, and a capsule's by nothing."""
    start, control = [0.0, 0.0, 0.1], ahead(0.7)
    motion, _ = both(write_robot(tmp_path, DRUM), obstacles, start, control)
    _, capsules = both(write_robot(tmp_path, CAPSULE), obstacles, start, control)
    assert motion.work.impulse_ns.max() > 0.01
    np.testing.assert_allclose(motion.body.qpos[:, :2], capsules.pose[:, :2], atol=1e-3)


@pytest.mark.parametrize(("bottom_m", "contacts"), [(0.28, True), (0.301, False)])
def test_a_cylinder_passes_under_what_is_above_its_level_end(tmp_path: Path, bottom_m: float, *, contacts: bool):
    table = Obstacles(np.array([box(0.6, 0.0, 0.2, 0.5, z=bottom_m + 0.03, half_z=0.03)]), NO_CYLINDERS)
    motion, theirs = both(write_robot(tmp_path, DRUM), table, [0.0, 0.0, 0.0], ahead(0.5))
    np.testing.assert_allclose(motion.body.qpos[:, :2], theirs.pose[:, :2], atol=1e-4)
    assert (motion.work.impulse_ns.max() > 0.0) == contacts


def test_a_robot_at_rest_presses_as_deep_into_a_wall_as_in_c(tmp_path: Path):
    motion, theirs = both(write_robot(tmp_path, {}), WALL, [0.0, 0.0, 0.0], ahead(1.0))
    depth_m = 0.18 - (0.5 - theirs.pose[-1, 0])
    assert depth_m > 1e-4
    assert -motion.clearance_m[-1] == pytest.approx(depth_m, rel=1e-3)


def test_the_impulse_is_what_the_wall_takes_from_the_robot(tmp_path: Path):
    push_n = 4.0
    control = np.tile([push_n, 0.0, 0.0], (SECONDS_2, 1))
    motion, _ = both(write_robot(tmp_path, {"motors": MOTORS}), WALL, [0.0, 0.0, 0.0], control)
    kept = 2.0 * motion.body.qvel[-1, 0]
    pushed = push_n * 0.05 * SECONDS_2
    assert motion.work.push_ns[:, 0].sum() == pytest.approx(kept - pushed, rel=1e-4)
    assert motion.work.impulse_ns.sum() == pytest.approx(pushed - kept, rel=1e-4)


def test_nothing_pushes_a_robot_that_touches_nothing(tmp_path: Path):
    motion, _ = both(write_robot(tmp_path, {"x/frictionloss": "0.5"}), WALL, [-3.0, 0.0, 0.0], ahead(0.5))
    assert not motion.work.impulse_ns.any()
    assert not motion.work.push_ns.any()


def test_motors_spend_their_force_times_their_speed(tmp_path: Path):
    control = np.tile([3.0, 0.0, 0.0], (SECONDS_2, 1))
    motion, _ = both(write_robot(tmp_path, {"motors": MOTORS}), WALL, [-5.0, 0.0, 0.0], control)
    # Under a constant force, work is force times way, but for the steps' speeds being those at their beginnings.
    way_m = motion.body.qpos[-1, 0] + 5.0
    assert motion.work.energy_j.sum() == pytest.approx(3.0 * way_m, rel=0.01)


def test_a_sphere_is_stopped_by_a_table_top_above_its_middle(tmp_path: Path):
    table = Obstacles(np.array([box(0.6, 0.0, 0.2, 0.5, z=0.33, half_z=0.03)]), NO_CYLINDERS)
    motion, theirs = both(write_robot(tmp_path, {}), table, [0.0, 0.0, 0.0], ahead(0.5))
    np.testing.assert_allclose(motion.body.qpos, theirs.pose, atol=PLACE_M)
    assert 0.18 < 0.4 - theirs.pose[-1, 0] + 0.06 < 0.3


def test_a_robot_that_starts_inside_an_obstacle_is_pushed_out_as_in_c(tmp_path: Path):
    block = Obstacles(np.array([box(0.1, 0.0, 0.2, 0.3)]), NO_CYLINDERS)
    motion, theirs = both(write_robot(tmp_path, {}), block, [0.05, 0.02, 0.0], ahead(0.0))
    np.testing.assert_allclose(motion.body.qpos, theirs.pose, atol=1e-5)
    assert theirs.pose[-1, 0] < -0.1


def test_the_clearance_is_that_of_the_nearest_disc(tmp_path: Path):
    arm: Parts = {"hull/size": "0.1", "more": '<geom name="arm" size="0.05" pos="0.25 0 0" mass="0.1"/>'}
    wall = Obstacles(np.array([box(0.0, 0.35, 2.0, 0.1)]), NO_CYLINDERS)
    motion, _ = both(write_robot(tmp_path, arm), wall, [0.0, 0.0, 0.0], ahead(0.0))
    assert not motion.work.impulse_ns.any()
    np.testing.assert_allclose(motion.clearance_m, 0.15, atol=1e-5)
