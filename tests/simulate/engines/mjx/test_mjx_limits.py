"""What stands in for a planar base's cylinders touches obstacles where they do, as C MuJoCo steps both."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import compile_robot
from tasks.simulate.engines.mjx.mjx_limits import with_stand_ins

ROBOT = """<mujoco><option timestep="0.005"/><worldbody><body name="b" pos="0 0 0.1">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="t" type="hinge" axis="0 0 1"/>{geoms}</body></worldbody>
<actuator><velocity joint="x" kv="40"/><velocity joint="y" kv="40"/></actuator></mujoco>"""
WHEELS = "".join(
    f'<geom type="cylinder" size="0.08 0.02" pos="{x} {y} 0" euler="90 0 {turn}" mass="0.5" condim="1"/>'
    for x, y, turn in ((0.15, 0.1, 0), (0.15, -0.1, 30), (-0.15, 0.1, 0), (-0.15, -0.1, 0))
)
DRUM = '<geom type="cylinder" size="0.2 0.1" mass="2" condim="1"/>'
LEANING = '<geom type="cylinder" size="0.2 0.1" euler="20 0 0" mass="2"/>'
LOW_MAST = DRUM + '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.5" mass="0.1"/>'


def robot(folder: Path, geoms: str) -> mujoco.MjSpec:
    path = folder / "robot.xml"
    path.write_text(ROBOT.format(geoms=geoms))
    return read_robot_mjcf(path)


def driven(spec: mujoco.MjSpec, way: float) -> np.ndarray:
    """Returns where a robot goes that is pushed along a way, into a wall that is turned by 20 degrees."""
    spec = spec.copy()
    wall = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 2.0, 0.5], pos=[0.6, 0.0, 0.5], condim=1)
    wall.quat = [np.cos(np.radians(10.0)), 0.0, 0.0, np.sin(np.radians(10.0))]
    model = compile_robot(spec)
    data, poses = mujoco.MjData(model), list[np.ndarray]()
    data.ctrl[:] = 0.5 * np.cos(way), 0.5 * np.sin(way)
    for _ in range(400):
        mujoco.mj_step(model, data)
        poses.append(np.copy(data.qpos))
    return np.array(poses)


@pytest.mark.parametrize("way", [0.0, 0.4, -0.7])
@pytest.mark.parametrize("geoms", [WHEELS, DRUM])
def test_a_robot_with_stand_ins_goes_where_the_one_with_cylinders_goes(tmp_path: Path, geoms: str, way: float):
    spec = robot(tmp_path, geoms)
    theirs = driven(spec, way)
    with_stand_ins(spec)
    ours = driven(spec, way)
    assert theirs[-1, 0] < 0.8  # the wall held it: it would have come to a metre by now
    assert np.abs(ours - theirs)[:, :2].max() < 1e-3


def test_cylinders_keep_their_mass_and_touch_nothing(tmp_path: Path):
    spec = robot(tmp_path, WHEELS)
    before, after = compile_robot(spec), with_stand_ins(spec)
    np.testing.assert_allclose(after.body_inertia, before.body_inertia)
    assert after.geom_contype[after.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER].sum() == 0


@pytest.mark.parametrize("geoms", [LEANING, LOW_MAST])
def test_what_no_shape_stands_in_for_exactly_stays(tmp_path: Path, geoms: str):
    model = with_stand_ins(robot(tmp_path, geoms))
    assert model.geom_contype[model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER].tolist() == [1]
