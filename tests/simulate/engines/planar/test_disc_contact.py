"""The window holds the obstacles nearest to the robot, of all kinds alike, nearest first."""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.simulate.engines.planar.disc_contact import Obstacle, bearing, contact, distance_m, edges, touch, window
from tasks.simulate.engines.planar.planar_algebra import Planar
from tasks.simulate.engines.planar.planar_robot import Disc, planar_robot
from tasks.simulate.geometry.hull_outline import inner_distance_m
from tasks.simulate.geometry.obstacles import obstacles, pad_obstacles
from tests.factories.planar import (
    CAPSULE,
    NO_BOXES,
    NO_CYLINDERS,
    ROUGH,
    Obstacles,
    Parts,
    among,
    box,
    on_device,
    prism,
    write_robot,
)  # fmt: skip
from tests.factories.simulations import cluttered

ALL = pad_obstacles([obstacles(cluttered(3), 0.02, 0.38)])[0]
COUNT = 6
PLACES = {"x": st.floats(-2.3, 6.4), "y": st.floats(-1.8, 1.8)}


def by_hand(x: float, y: float) -> np.ndarray:
    """Returns the distances of all obstacles from a point, boxes first."""
    right, up = x - ALL.boxes[:, 0], y - ALL.boxes[:, 1]
    cos, sin = ALL.boxes[:, 6], ALL.boxes[:, 7]
    beyond = np.abs(np.stack([cos * right + sin * up, cos * up - sin * right])) - ALL.boxes[:, 3:5].T
    round_ones = np.hypot(ALL.cylinders[:, 0] - x, ALL.cylinders[:, 1] - y) - ALL.cylinders[:, 3]
    return np.concatenate([np.hypot(*np.maximum(beyond, 0.0)), round_ones])


def near(x: float, y: float) -> list[Obstacle]:
    return window(on_device(ALL), jnp.array([x, y], jnp.float32), COUNT)


@settings(max_examples=25)
@given(**PLACES)
def test_no_obstacle_outside_is_nearer_than_one_inside(x: float, y: float):
    held = [float(distance_m([each], jnp.zeros(()), jnp.zeros(()))) for each in near(x, y)]
    np.testing.assert_allclose(held, np.sort(by_hand(x, y))[:COUNT], atol=2e-3)


@settings(max_examples=25)
@given(**PLACES)
def test_the_nearest_of_all_is_known_exactly(x: float, y: float):
    assert float(distance_m(near(x, y), jnp.zeros(()), jnp.zeros(()))) == pytest.approx(by_hand(x, y).min(), abs=1e-5)


def test_an_obstacle_keeps_its_figures_but_for_its_place():
    cylinder = int(np.argmin(np.hypot(*(ALL.cylinders[:, :2] - [2.0, 0.0]).T)))
    x, y, z, radius, half = (float(each) for each in ALL.cylinders[cylinder])
    first = near(x, y)[0]
    assert bool(first.round)
    assert (float(first.x), float(first.y)) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert (float(first.radius), float(first.height), float(first.half_height)) == pytest.approx((radius, z, half))
    assert (float(first.half_x), float(first.half_y)) == (0.0, 0.0)


def test_fewer_obstacles_than_the_window_holds_are_all_in_it():
    few = on_device((ALL.boxes[:2], ALL.cylinders[:1], ALL.prisms))
    assert len(window(few, jnp.zeros(2), COUNT)) == 3


POSES = 400
HULLS: dict[str, Parts] = {
    "sphere": {},
    "capsule": CAPSULE,
    "capsule upside down": {**CAPSULE, "hull/quat": "0 1 0 0"},
    "tall capsule": {"hull/type": "capsule", "hull/size": "0.18 0.3"},
    "sphere ahead": {"hull/size": "0.15", "hull/pos": "0.1 0.04 0"},
}
CORNERS = np.array([[-0.25, -0.1], [0.0, -0.2], [0.25, -0.05], [0.1, 0.2], [-0.1, 0.15]])
SOLIDS = {
    "box": Obstacles(np.array([box(0.0, 0.0, 0.25, 0.15, yaw=0.4, z=1.0, half_z=0.15)]), np.zeros((0, 5))),
    "cylinder": Obstacles(np.zeros((0, 8)), np.array([[0.0, 0.0, 1.0, 0.2, 0.15]])),
    "prism": Obstacles(NO_BOXES, NO_CYLINDERS, np.array([prism(0.0, 0.0, CORNERS, z=1.0, half_z=0.15)])),
}
PARKED = Obstacles(np.array([box(900.0, 0.0, 0.1, 0.1)]), np.array([[-900.0, 0.0, 0.0, 0.1, 0.1]]))


def in_c(model: mujoco.MjModel, data: mujoco.MjData, height: float, pose: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Returns the sums of D J J' and of D J a over C's rows, with the obstacle's middle at a height."""
    model.geom_pos[0][2] = height
    data.qpos[:], data.qvel[:] = pose, rate
    mujoco.mj_forward(model, data)
    jacobian = np.array(data.efc_J).reshape(-1, 3)
    weighted = jacobian.T * data.efc_D
    return np.concatenate([(weighted @ jacobian).ravel(), weighted @ data.efc_aref])


def in_plane(disc: Disc, solid: Obstacles, height: jax.Array, pose: jax.Array, rate: jax.Array) -> jax.Array:
    """Returns the same sums over the engine's rows."""
    near = window(on_device(solid), jnp.zeros(2), 1)[0]._replace(height=height)
    cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
    arm = (cos * disc.forward_m - sin * disc.left_m, sin * disc.forward_m + cos * disc.left_m)
    touched = touch(disc, near, bearing(disc, near), pose[0] + arm[0], pose[1] + arm[1])
    made = contact(disc, touched, arm, Planar(*rate))
    rows = jnp.stack([jnp.stack([row.x, row.y, jnp.asarray(row.turn)]) for row in edges(made)])
    targets = jnp.stack([row.target for row in edges(made)])
    return jnp.concatenate([(made.weight * rows.T @ rows).ravel(), made.weight * rows.T @ targets])


def scattered(disc: Disc, solid: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns heights, poses that touch by up to 3 cm more or less, and rates."""
    heights = disc.height_m + rng.uniform(-0.5, 0.5, POSES)
    angle, way = rng.uniform(-np.pi, np.pi, POSES), rng.uniform(0.2, 0.45, POSES)
    yaw = rng.uniform(-np.pi, np.pi, POSES)
    arm = np.hypot(disc.forward_m, disc.left_m)
    turn = yaw + np.arctan2(disc.left_m, disc.forward_m)
    x, y = way * np.cos(angle) - arm * np.cos(turn), way * np.sin(angle) - arm * np.sin(turn)
    if solid == "box":  # a capsule whose axis is inside a box is left out: MuJoCo pushes it out this way or that
        cos, sin = np.cos(0.4), np.sin(0.4)
        right, up = way * np.cos(angle), way * np.sin(angle)
        outside = (np.abs(cos * right + sin * up) > 0.251) | (np.abs(cos * up - sin * right) > 0.151)
        x = np.where(outside, x, x + 10.0)
    if solid == "prism":  # likewise, and at a corner C turns a capsule's normal
        axis = np.stack([way * np.cos(angle), way * np.sin(angle)], axis=1)
        x = np.where(at_face(axis) if disc.capsule else inner_distance_m(CORNERS, axis) > 1e-3, x, x + 10.0)
    return heights, np.stack([x, y, yaw], axis=1), rng.normal(0.0, 0.5, (POSES, 3))


def at_face(points: np.ndarray) -> np.ndarray:
    """Returns which points are outside the prism, and nearer to the inside of an edge than to a corner."""
    to_corner = np.linalg.norm(points[:, None] - CORNERS, axis=-1).min(axis=1)
    apart = inner_distance_m(CORNERS, points)
    return (apart > 1e-3) & (apart < to_corner - 1e-3)


@pytest.mark.parametrize("ground", [{}, ROUGH], ids=["condim 1", "condim 3"])
@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize("hull", HULLS)
def test_rows_are_those_of_c(tmp_path: Path, hull: str, solid: str, ground: Parts):
    path = write_robot(tmp_path, {**HULLS[hull], **ground})
    disc = planar_robot(path).discs[0]
    heights, poses, rates = scattered(disc, solid, np.random.default_rng(7))
    both = Obstacles(*(np.concatenate([real, far]) for real, far in zip(SOLIDS[solid], PARKED, strict=True)))
    model = among(path, SOLIDS[solid])
    data = mujoco.MjData(model)
    theirs = np.stack([in_c(model, data, *each) for each in zip(heights, poses, rates, strict=True)])
    ours = jax.jit(jax.vmap(lambda *each: in_plane(disc, both, *each)))(
        *(jnp.asarray(each, jnp.float32) for each in (heights, poses, rates))
    )
    touching = np.abs(theirs[:, :9]).sum(axis=1) > 0
    assert 40 < touching.sum() < POSES
    scale = np.maximum(np.abs(theirs).max(axis=1, keepdims=True), 1.0)
    np.testing.assert_allclose(np.asarray(ours) / scale, theirs / scale, atol=2e-4)
