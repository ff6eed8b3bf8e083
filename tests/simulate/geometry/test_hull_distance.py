"""A hull's distance to obstacles is MuJoCo's, whatever its shape, and never negative where nothing touches."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from tasks.simulate.application.robot_model import add_prism_mesh
from tasks.simulate.geometry.hull_distance import LaneObstacles, hull_distance_m
from tasks.simulate.geometry.hull_outline import hull_parts
from tests.factories.planar import prism
from tests.factories.simulations import convex

CASES = 150
NO_PRISMS = jnp.zeros((0, 20))
BODY = """<body name="base" pos="0 0 0.3"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
<joint type="hinge" axis="0 0 1"/>{hull}</body>"""
FILE = '<mujoco><worldbody>{solids}{body}</worldbody><actuator><motor joint="x"/></actuator></mujoco>'
# Hulls, and how far from MuJoCo's their distance may be: outlines with corners on round ones are a little smaller.
HULLS = {
    "sphere": ('<geom type="sphere" size="0.2"/>', 1e-5),
    "box": ('<geom type="box" size="0.25 0.15 0.1" pos="0.05 0.02 0" euler="0 0 20"/>', 1e-5),
    "upright cylinder": ('<geom type="cylinder" size="0.2 0.1" pos="0.1 0 0"/>', 1e-5),
    "lying capsule": ('<geom type="capsule" size="0.1 0.2" euler="90 0 0"/>', 1e-5),
    "lying cylinder": ('<geom type="cylinder" size="0.1 0.2" euler="90 0 30"/>', 2e-4),
    "leaning box": ('<geom type="box" size="0.25 0.15 0.1" euler="30 20 10"/>', 1e-5),
    "ellipsoid": ('<geom type="ellipsoid" size="0.2 0.1 0.1"/>', 3e-3),
    "box and post": (
        '<geom type="box" size="0.2 0.1 0.1"/><geom type="cylinder" size="0.05 0.1" pos="0.3 0.1 0"/>',
        1e-5,
    ),
}


def drawn(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns a pose beside a box at the origin, a cylinder and a prism, all tall, as the engines have them."""
    pose = np.r_[rng.uniform(-0.9, 0.9, 2), rng.uniform(-3.0, 3.0)]
    (half_x, half_y), yaw = rng.uniform(0.05, 0.5, 2), rng.uniform(-3.0, 3.0)
    box = np.array([0.0, 0.0, 1.0, half_x, half_y, 1.0, np.cos(yaw), np.sin(yaw)])
    post = np.array([*rng.uniform(-1.5, 1.5, 2), 1.0, rng.uniform(0.05, 0.4), 1.0])
    x, y = rng.uniform(-1.5, 1.5, 2)
    wedge = prism(x, y, convex(rng, 0.5), z=1.0, half_z=1.0)
    return pose, box, post, np.array(wedge)


def mujocos_m(hull: str, pose: np.ndarray, box: np.ndarray, post: np.ndarray, wedge: np.ndarray) -> float:
    """Returns the least distance that C MuJoCo finds between geoms of the hull and the obstacles."""
    yaw = np.degrees(np.arctan2(box[7], box[6]))
    solids = (
        f'<geom type="box" size="{box[3]} {box[4]} {box[5]}" pos="0 0 1" euler="0 0 {yaw}"/>'
        f'<geom type="cylinder" size="{post[3]} {post[4]}" pos="{post[0]} {post[1]} 1"/>'
    )
    spec = mujoco.MjSpec.from_string(FILE.format(solids=solids, body=BODY.format(hull=hull)))
    add_prism_mesh(spec, "wedge", wedge[4:].reshape(-1, 2), 1.0)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="wedge", pos=[*wedge[:2], 1.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    still = [geom for geom in range(model.ngeom) if not model.geom_bodyid[geom]]
    pairs = [(solid, geom) for solid in still for geom in range(model.ngeom) if geom not in still]
    return min(mujoco.mj_geomDistance(model, data, solid, geom, 10.0, None) for solid, geom in pairs)


@pytest.mark.long
@pytest.mark.parametrize("name", HULLS)
def test_it_is_what_mujoco_says_between_geoms(name: str):
    hull, off_m = HULLS[name]
    parts = hull_parts(mujoco.MjModel.from_xml_string(FILE.format(solids="", body=BODY.format(hull=hull))))
    rng = np.random.default_rng(3)
    cases = [drawn(rng) for _ in range(CASES)]
    poses, boxes, posts, wedges = (jnp.asarray(np.array(each), jnp.float32) for each in zip(*cases, strict=True))
    measure = jax.jit(
        jax.vmap(lambda pose, *kinds: hull_distance_m(parts, LaneObstacles(*(kind[None] for kind in kinds)), pose))
    )
    ours, theirs = (
        np.asarray(measure(poses, boxes, posts, wedges)),
        np.array([mujocos_m(hull, *case) for case in cases]),
    )
    apart = theirs > 0.0
    assert CASES / 5 < apart.sum() < CASES
    np.testing.assert_allclose(ours[apart], theirs[apart], atol=off_m)
    assert (ours[apart] >= 0.0).all()
    assert (ours[~apart] < off_m).all()


def test_a_solid_above_one_part_of_the_hull_is_not_near_it():
    mast = '<geom type="box" size="0.3 0.3 0.1"/><geom type="cylinder" size="0.05 0.5" pos="0 0 0.3"/>'
    parts = hull_parts(mujoco.MjModel.from_xml_string(FILE.format(solids="", body=BODY.format(hull=mast))))
    table = jnp.array([[0.6, 0.0, 0.6, 0.4, 0.4, 0.02, 1.0, 0.0]])
    around = LaneObstacles(table, jnp.array([[50.0, 50.0, 1.0, 0.1, 1.0]]), NO_PRISMS)
    assert float(hull_distance_m(parts, around, jnp.zeros(3))) == pytest.approx(0.15, abs=1e-6)


def test_what_lies_inside_another_part_is_left_out():
    wheels = '<geom type="box" size="0.3 0.3 0.1"/><geom type="cylinder" size="0.08 0.02" euler="90 0 0"/>'
    parts = hull_parts(mujoco.MjModel.from_xml_string(FILE.format(solids="", body=BODY.format(hull=wheels))))
    assert [len(part.corners) for part in parts] == [4]
