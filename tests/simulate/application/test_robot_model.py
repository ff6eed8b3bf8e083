"""Messages call a part of a robot by its name, or by where it stands in the file."""

from pathlib import Path

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    actuator_label,
    base_of,
    body_label,
    coordinates_at,
    geom_label,
    hull_of,
    joint_label,
    pose_of,
    velocity_of,
)
from tasks.simulate.engines.mjx.mjx_robot import load_robot
from tests.factories.simulations import COURIER, FAULTY, FOLDERS

FILE = """<mujoco><worldbody>
  <body name="base"><freejoint/><geom size="0.1"/><geom type="box" size="0.1 0.1 0.1"/><geom name="mast" size="0.1"/>
    <body><joint name="left"/><geom type="cylinder" size="0.1 0.1"/></body>
    <body><joint axis="0 1 0"/><geom type="capsule" size="0.1 0.1"/></body>
  </body></worldbody>
  <actuator><motor name="drive" joint="left"/><motor joint="left"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjSpec.from_string(FILE).compile()


def test_a_geom_without_a_name_has_its_place_its_type_and_its_body(model: mujoco.MjModel):
    assert [geom_label(model, geom) for geom in range(model.ngeom)] == [
        "the 1st geom (sphere) of body 'base'",
        "the 2nd geom (box) of body 'base'",
        "geom 'mast'",
        "the 1st geom (cylinder) of the 1st body in body 'base'",
        "the 1st geom (capsule) of the 2nd body in body 'base'",
    ]


def test_a_body_without_a_name_has_its_place(model: mujoco.MjModel):
    assert body_label(model, 1) == "body 'base'"
    assert body_label(model, 3) == "the 2nd body in body 'base'"


def test_a_joint_and_an_actuator_without_names_have_their_places(model: mujoco.MjModel):
    assert joint_label(model, 0) == "the 1st joint (free) of body 'base'"
    assert joint_label(model, 1) == "joint 'left'"
    assert [actuator_label(model, number) for number in range(2)] == ["actuator 'drive'", "the 2nd actuator"]


PLANAR = """<mujoco><option timestep="0.005"/><worldbody><body name="b" pos="0 0 0.3">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="t" type="hinge" axis="0 0 1"/>{geom}</body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
BALL = '<geom name="hull" type="sphere" size="0.2" mass="1"/>'


def robot(folder: Path, text: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("geom", "radius_m", "low_m", "high_m"),
    [
        (BALL, 0.2, 0.1, 0.5),
        ('<geom type="sphere" size="0.2" pos="0.1 0 0" mass="1"/>', 0.3, 0.1, 0.5),
        ('<geom type="capsule" size="0.1 0.15" mass="1"/>', 0.1, 0.05, 0.55),
        ('<geom type="box" size="0.3 0.4 0.1" mass="1"/>', 0.5, 0.2, 0.4),
        ('<geom type="cylinder" size="0.2 0.15" mass="1"/>', 0.2, 0.15, 0.45),
        ('<geom type="cylinder" size="0.2 0.3" euler="90 0 0" mass="1"/>', 0.3606, 0.1, 0.5),
        ('<geom type="ellipsoid" size="0.1 0.2 0.1" mass="1"/>', 0.2236, 0.2, 0.4),
        (BALL + '<geom type="box" size="0.25 0.25 1" mass="0" contype="0" conaffinity="0"/>', 0.2, 0.1, 0.5),
    ],
)
def test_the_hull_encloses_what_collides(tmp_path: Path, geom: str, radius_m: float, low_m: float, high_m: float):
    hull = hull_of(read_robot_mjcf(robot(tmp_path, PLANAR.format(geom=geom))).compile())
    assert hull == pytest.approx((radius_m, low_m, high_m, 1.0), abs=1e-4)


def test_scenery_in_a_robots_file_is_left_out():
    model = read_robot_mjcf(FOLDERS[FAULTY] / "robot.xml").compile()
    assert [model.geom(k).name for k in range(model.ngeom)] == ["body"]


def test_a_robot_with_other_joints_is_refused(tmp_path: Path):
    legged = PLANAR.format(geom=BALL).replace('type="slide" axis="0 1 0"', 'type="hinge" axis="0 1 0"')
    with pytest.raises(
        RobotRefused,
        match=r"body 'b': x \(slide along x\), y \(hinge about y\), t .*free joint, or slide along x, slide along y",
    ):
        read_robot_mjcf(robot(tmp_path, legged))


def test_a_hull_that_mjx_cannot_collide_is_refused_by_name(tmp_path: Path):
    cylinder = PLANAR.format(geom='<geom name="drum" type="cylinder" size="0.2 0.1" euler="20 0 0" mass="1"/>')
    with pytest.raises(
        RobotRefused, match=r"geom 'drum': MJX cannot collide a cylinder .*use a sphere.* engine: mujoco"
    ):
        load_robot(robot(tmp_path, cylinder))


def test_a_robot_that_touches_nothing_is_refused(tmp_path: Path):
    ghost = PLANAR.format(geom=BALL.replace("mass", 'contype="0" conaffinity="0" mass'))
    with pytest.raises(RobotRefused, match="no geom collides"):
        load_robot(robot(tmp_path, ghost))


def test_a_robot_without_actuators_is_refused(tmp_path: Path):
    bare = PLANAR.format(geom=BALL).replace('<actuator><motor joint="x"/></actuator>', "")
    with pytest.raises(RobotRefused, match="no actuator"):
        read_robot_mjcf(robot(tmp_path, bare))


@pytest.mark.parametrize(("timestep", "steps"), [("0.005", 10), ("0.007", 8), ("0.02", 3), ("0.05", 1), ("0.2", 1)])
def test_a_timestep_that_does_not_divide_a_control_step_is_shortened(tmp_path: Path, timestep: str, steps: int):
    loaded = load_robot(robot(tmp_path, PLANAR.format(geom=BALL).replace("0.005", timestep)))
    assert loaded.physics_steps == steps
    assert loaded.host.opt.timestep == pytest.approx(0.05 / steps)


def test_a_timestep_of_0_is_refused(tmp_path: Path):
    with pytest.raises(RobotRefused, match="option timestep 0 s: must be above 0"):
        read_robot_mjcf(robot(tmp_path, PLANAR.format(geom=BALL).replace("0.005", "0")))


@pytest.mark.parametrize(
    ("option", "geom", "culprit"),
    [
        ('integrator="implicit"', BALL, "option integrator implicit: MJX steps Euler"),
        ('cone="elliptic"', BALL.replace("mass", 'condim="1" mass'), "option cone elliptic: .* geom 'hull'"),
        (
            "",
            f'{BALL}</body></worldbody><custom><numeric name="max_contact_points" data="0"/></custom><worldbody><body>'
            '<geom size="1"/>',
            "custom numeric max_contact_points: MJX would drop",
        ),
        ("", BALL.replace("sphere", "ellipsoid").replace('"0.2"', '"0.2 0.1 0.2"'), "geom 'hull': .* an? ellipsoid"),
    ],
)
def test_what_mjx_lacks_is_refused_by_name_with_the_remedy(tmp_path: Path, option: str, geom: str, culprit: str):
    text = PLANAR.format(geom=geom).replace("<option", f"<option {option}")
    with pytest.raises(RobotRefused, match=f"{culprit}.*or set engine: mujoco"):
        load_robot(robot(tmp_path, text))


FREE = """<mujoco><worldbody><geom name="ground" type="plane" size="9 9 1" friction="0.3 0.1 0.1" condim="4"/>
<body name="b" pos="1 2 0.3"><freejoint/><geom name="hull" type="sphere" size="0.2"/><body name="arm" pos="0.2 0 0">
<joint name="j"/><geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/></body></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""


def test_a_robot_with_a_free_joint_stands_on_the_floor_of_its_file(tmp_path: Path):
    model = read_robot_mjcf(robot(tmp_path, FREE)).compile()
    floor = model.geom("simyard/floor")
    assert (floor.type[0], floor.condim[0], floor.friction[0], floor.pos[2]) == (mujoco.mjtGeom.mjGEOM_PLANE, 4, 0.3, 0)
    assert base_of(model) == (1, True, True)


def test_a_robot_without_a_floor_gets_one(tmp_path: Path):
    bare = FREE.replace(FREE[FREE.index("<geom name=") : FREE.index("<body name")], "")
    model = read_robot_mjcf(robot(tmp_path, bare)).compile()
    assert model.geom("simyard/floor").friction[0] == 1.0


def test_the_hull_of_what_walks_reaches_from_the_floor_around_its_base(tmp_path: Path):
    hull = hull_of(read_robot_mjcf(robot(tmp_path, FREE)).compile())
    # Of the density that MuJoCo takes where none is said: a ball of 0.2 m, and an arm of 0.3 m between two half balls.
    ball_kg, arm_kg = 4e3 / 3 * np.pi * 0.2**3, 1e3 * np.pi * (0.05**2 * 0.3 + 4 / 3 * 0.05**3)
    assert hull == pytest.approx((0.55, 0.0, 0.5, ball_kg + arm_kg))


def test_a_robot_rests_as_its_first_keyframe_says(tmp_path: Path):
    text = FREE.replace("</mujoco>", '<keyframe><key qpos="0 0 0.4 1 0 0 0 1.2"/></keyframe></mujoco>')
    loaded = load_robot(robot(tmp_path, text))
    assert loaded.rest == pytest.approx([0, 0, 0.4, 1, 0, 0, 0, 1.2])
    assert loaded.hull.high_m == pytest.approx(0.6)


def test_two_robots_in_a_file_are_refused_by_name(tmp_path: Path):
    two = FREE.replace("</worldbody>", '<body name="ball"><freejoint/><geom size="0.1"/></body></worldbody>')
    with pytest.raises(RobotRefused, match="bodies in the world: 'b', 'ball': one must be the robot's base"):
        read_robot_mjcf(robot(tmp_path, two))


def test_what_stands_in_a_robots_file_is_left_out(tmp_path: Path):
    fenced = FREE.replace("</worldbody>", '<body name="fence"><geom size="0.1"/></body></worldbody>')
    model = read_robot_mjcf(robot(tmp_path, fenced)).compile()
    assert [model.body(k).name for k in range(model.nbody)] == ["world", "b", "arm"]


@pytest.mark.parametrize("text", ["", "<mujoco><worldbody><body></mujoco>", "no xml"])
def test_a_file_that_is_no_mjcf_is_refused(tmp_path: Path, text: str):
    with pytest.raises(RobotRefused, match=r"robot\.xml"):
        read_robot_mjcf(robot(tmp_path, text))


def test_a_missing_file_is_refused(tmp_path: Path):
    with pytest.raises(RobotRefused, match=r"robot\.xml"):
        read_robot_mjcf(tmp_path / "robot.xml")


def test_the_courier_is_a_ball_of_18_cm_two_centimetres_above_the_floor():
    loaded = load_robot(FOLDERS[COURIER] / "robot.xml")
    assert loaded.hull == pytest.approx((0.18, 0.02, 0.38, 2.0))
    assert loaded.physics_steps == 10
    assert loaded.actuators == 3


FREE_BODY = """<mujoco><worldbody><body name="b" pos="1 2 0.7" euler="20 10 40"><freejoint/><geom size="0.1"/>
<body><joint name="j" axis="0 1 0"/><geom size="0.05" pos="0.2 0 0"/></body></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(FREE_BODY)
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
