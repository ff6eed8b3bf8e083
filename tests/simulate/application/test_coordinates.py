"""Pose and velocity in the plane are those that C MuJoCo computes for the base's frame."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.application.robot_model import base_of, coordinates_at, pose_of, velocity_of

FREE = """<mujoco><worldbody><body name="b" pos="1 2 0.7" euler="20 10 40"><freejoint/><geom size="0.1"/>
<body><joint name="j" axis="0 1 0"/><geom size="0.05" pos="0.2 0 0"/></body></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(FREE)
BASE = base_of(MODEL)
ANGLES = st.floats(-3.1, 3.1)


def frame(qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(MODEL, data)
    return data


@given(st.floats(-5, 5), st.floats(-5, 5), ANGLES)
def test_a_robot_is_placed_as_tall_and_as_tilted_as_it_rests(x: float, y: float, yaw: float):
    rest = frame(MODEL.qpos0, np.zeros(MODEL.nv))
    there = frame(coordinates_at(BASE, MODEL.qpos0, np.array([x, y, yaw]), np), np.zeros(MODEL.nv))
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    np.testing.assert_allclose(there.xpos[1], [x, y, rest.xpos[1][2]], atol=1e-12)
    np.testing.assert_allclose(there.xmat[1].reshape(3, 3), turn @ rest.xmat[1].reshape(3, 3), atol=1e-12)
    assert there.qpos[-1] == MODEL.qpos0[-1]


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1), ANGLES)
def test_pose_and_velocity_are_the_base_frames(quaternion: list[float], rate: float):
    qpos = np.array([0.3, -0.4, 1.0, *(np.array(quaternion) / np.linalg.norm(quaternion)), 0.2])
    qvel = np.array([0.5, -0.2, 0.1, rate, 0.7, -0.3, 1.0])
    data = frame(qpos, qvel)
    turn, spin = data.xmat[1].reshape(3, 3), np.zeros(6)
    mujoco.mj_objectVelocity(MODEL, data, mujoco.mjtObj.mjOBJ_XBODY, 1, spin, 0)
    ahead = np.arctan2(turn[1, 0], turn[0, 0])
    if np.hypot(turn[1, 0], turn[0, 0]) > 1e-3:
        np.testing.assert_allclose(pose_of(BASE, qpos, np), [0.3, -0.4, ahead], atol=1e-9)
    np.testing.assert_allclose(velocity_of(BASE, qpos, qvel, np), [0.5, -0.2, spin[2]], atol=1e-9)


@pytest.mark.parametrize("lanes", [1, 5])
def test_many_robots_are_each_as_one_and_jax_agrees(lanes: int):
    rng = np.random.default_rng(lanes)
    starts = rng.uniform(-3, 3, (lanes, 3))
    together = coordinates_at(BASE, MODEL.qpos0, starts, np)
    for start, qpos in zip(starts, together, strict=True):
        np.testing.assert_array_equal(coordinates_at(BASE, MODEL.qpos0, start, np), qpos)
        np.testing.assert_allclose(pose_of(BASE, jnp.asarray(qpos), jnp), pose_of(BASE, qpos, np), atol=1e-5)
