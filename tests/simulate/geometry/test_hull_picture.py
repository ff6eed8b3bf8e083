"""What a camera sees of its own robot, beside solids of a world that have the same shapes, and beside formulas."""

from pathlib import Path

import jax
import numpy as np
import pytest
from jaxtyping import Float

from tasks.simulate.geometry.depth_picture import DepthScene, View, depth_picture, pad_scenes, rays_of
from tasks.simulate.geometry.hull_picture import Mount, hull_picture

VIEW = View(columns=40, rows=30, fov_rad=1.6, pitch_rad=0.4, range_m=5.0)
MOUNT = Mount(-0.3, 0.05, 0.7, 0.1)
ROBOT = """<mujoco>
  <worldbody>
    <geom type="box" size="5 5 0.1" pos="0 0 -0.1"/>
    <body name="base" pos="0 0 0.2">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint name="yaw" type="hinge" axis="0 0 1"/>
      <geom type="box" size="0.3 0.2 0.1" mass="2" rgba="1 0 0 1"/>
      {parts}
    </body>
  </worldbody>
  <actuator><velocity joint="yaw"/></actuator>
</mujoco>"""
MAST = '<geom type="cylinder" pos="0.2 -0.1 0.25" size="0.03 0.15" mass="0" contype="0" conaffinity="0"/>'
FIN = '<geom type="box" pos="0.1 0.15 0.2" size="0.1 0.02 0.1" euler="0 0 30" mass="0"/>'
BALL = '<geom type="sphere" pos="0.25 0 0.25" size="0.1" mass="0"/>'
GLASS = '<geom type="sphere" pos="-0.3 0.05 0.3" size="0.1" mass="0" rgba="0 0 0 0"/>'


class Pictures:
    """What cameras see of robots of some parts."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._robots = folder, 0

    def __call__(self, *parts: str, view: View = VIEW, mount: Mount = MOUNT) -> Float[np.ndarray, "rows columns"]:
        self._robots += 1
        path = self._folder / f"{self._robots}.xml"
        path.write_text(ROBOT.format(parts="".join(parts)))
        return hull_picture(path, view, mount)


@pytest.fixture
def pictures(tmp_path: Path) -> Pictures:
    return Pictures(tmp_path)


def as_solids(
    *boxes: tuple[float, ...], cylinders: tuple[tuple[float, ...], ...] = ()
) -> Float[np.ndarray, "rows columns"]:
    """Returns what the camera sees of solids of a world, with the robot's base at the origin."""
    given = ((boxes, 8), (cylinders, 5), ((), 29))
    kinds = (np.array(rows, np.float32).reshape(-1, count) for rows, count in given)
    (scene,) = pad_scenes([DepthScene(*kinds, ceiling_m=np.array([9.0], np.float32))])
    eye = np.array([*MOUNT[:3], MOUNT.yaw_rad], np.float32)
    return np.asarray(jax.jit(lambda seen, eye: depth_picture(seen, eye, VIEW, floor=False))(scene, eye))


def test_boxes_and_cylinders_are_seen_as_those_of_a_world(pictures: Pictures):
    found = pictures(MAST, FIN, GLASS)
    cos, sin = np.cos(np.pi / 6), np.sin(np.pi / 6)
    base, fin = (0.0, 0.0, 0.1, 0.3, 0.3, 0.2, 1.0, 0.0), (0.1, 0.15, 0.3, 0.5, 0.1, 0.02, cos, sin)
    wanted = as_solids(base, fin, cylinders=((0.2, -0.1, 0.3, 0.6, 0.03),))
    off = np.abs(found - wanted) > 1e-5
    assert off.mean() < 0.01, "but for pixels at an edge"
    assert 0.1 < (found < VIEW.range_m).mean() < 0.9
    assert len(np.unique(np.round(wanted, 2))) > 20


def test_a_ball_is_round(pictures: Pictures):
    with_ball, without = pictures(BALL), pictures()
    rays = np.stack(np.broadcast_arrays(*rays_of(VIEW)), axis=-1).astype(np.float64)
    cos, sin = np.cos(MOUNT.yaw_rad), np.sin(MOUNT.yaw_rad)
    x, y, z = np.array([0.25, 0.0, 0.45]) - MOUNT[:3]
    middle = np.array([cos * x + sin * y, cos * y - sin * x, z])
    square, half = (rays**2).sum(-1), rays @ middle
    under = half**2 - square * (middle @ middle - 0.1**2)
    depth_m = np.where(under > 0.0, (half - np.sqrt(np.maximum(under, 0.0))) / square, VIEW.range_m)
    np.testing.assert_allclose(with_ball, np.minimum(without, depth_m), atol=1e-5)
    assert (with_ball < without).sum() > 20


def test_what_a_camera_is_within_it_does_not_see(pictures: Pictures):
    within = Mount(0.2, -0.1, 0.45, np.arctan2(0.1, 0.05))
    alone = pictures(BALL, mount=within)
    np.testing.assert_array_equal(pictures(MAST, BALL, mount=within), alone)
    assert (alone < VIEW.range_m).any()


def test_what_is_behind_or_beyond_its_range_is_not_seen(pictures: Pictures):
    level = VIEW._replace(pitch_rad=0.0)
    assert (pictures(MAST, BALL, view=level, mount=Mount(0.5, 0.0, 0.4, 0.0)) == np.float32(VIEW.range_m)).all()
    ahead = Mount(-0.4, 0.0, 0.4, 0.0)
    above = slice(VIEW.rows // 2)  # where the base is not
    assert (pictures(BALL, view=level, mount=ahead)[above] < VIEW.range_m).any()
    assert (pictures(BALL, view=level._replace(range_m=0.5), mount=ahead)[above] == np.float32(0.5)).all()
