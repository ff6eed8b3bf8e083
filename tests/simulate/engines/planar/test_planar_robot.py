"""What the planar engine cannot represent is refused: the culprit's name, what was found, and the remedy."""

from pathlib import Path

import pytest

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.engines.planar.planar_robot import planar_robot
from tests.factories.planar import CAPSULE, DRUM, MOTORS, Parts, write_robot

ELSEWHERE = "or set engine: auto or mujoco"
REFUSED: list[tuple[str, Parts, tuple[str, ...]]] = [
    ("integrator", {"option/integrator": "RK4"}, ("option integrator rk4", "set one of them")),
    ("cone", {"option/cone": "elliptic", "hull/condim": "3"}, ("option cone elliptic", "set pyramidal")),
    ("air", {"option/density": "1.2"}, ("option density 1.2", "set both to 0")),
    ("noslip", {"option/noslip_iterations": "3"}, ("option noslip_iterations 3", "set 0")),
    ("lying", {**DRUM, "hull/euler": "90 0 0"}, ("geom 'hull': a cylinder that leans by 1", "upright", "pos and size")),
    ("box", {"hull/type": "box", "hull/size": "0.2 0.1 0.1"}, ("geom 'hull': a box", "spheres", "give it a cylinder")),
    (
        "egg",
        {"hull/type": "ellipsoid", "hull/size": "0.2 0.1 0.1"},
        ("geom 'hull': an ellipsoid", "give it a cylinder"),
    ),
    (
        "no name",
        {"more": '<geom type="box" size="0.2 0.1 0.1"/>'},
        ("the 2nd geom (box) of body 'base': a box", "spheres, and capsules and cylinders that stand upright"),
    ),
    ("leaning", {**CAPSULE, "hull/euler": "10 0 0"}, ("geom 'hull': a capsule that leans by 0.17", "pos and size")),
    ("condim", {"hull/condim": "4"}, ("geom 'hull'", "condim 4", "set one of them")),
    ("ghost", {"hull/contype": "0", "hull/conaffinity": "0"}, ("no geom collides", "contype")),
    ("muscle", {"motors": '<general name="arm" joint="x" dyntype="muscle"/>'}, ("actuator 'arm'", "muscle", "filters")),
    ("body", {"motors": '<adhesion name="glue" body="base" ctrlrange="0 1"/>'}, ("actuator 'glue'", "body", "joint")),
    (
        "refsite",
        {"motors": '<position name="ahead" site="drive" refsite="far"/>', "more": '<site name="far"/>'},
        ("actuator 'ahead'", "refsite", "remove refsite"),
    ),
    (
        "arm",
        {"more": '<body name="arm"><joint name="elbow"/><geom size="0.05"/></body>'},
        ("joint 'elbow'", "hinge", "remove it"),
    ),
]


@pytest.mark.parametrize(("parts", "told"), [case[1:] for case in REFUSED], ids=[name for name, *_ in REFUSED])
def test_a_refusal_names_the_culprit_and_the_remedy(tmp_path: Path, parts: Parts, told: tuple[str, ...]):
    with pytest.raises(RobotRefused) as refusal:
        planar_robot(write_robot(tmp_path, parts))
    for words in told:
        assert words in str(refusal.value)


def test_a_refusal_says_where_else_the_robot_can_run(tmp_path: Path):
    with pytest.raises(RobotRefused, match=ELSEWHERE):
        planar_robot(write_robot(tmp_path, {"option/integrator": "RK4"}))


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path):
    with pytest.raises(RobotRefused) as refusal:
        planar_robot(write_robot(tmp_path, {"option/integrator": "RK4", "x/damping": "1 2", "hull/condim": "6"}))
    for words in ("integrator", "joint 'x'", "geom 'hull'"):
        assert words in str(refusal.value)


FROMTO: Parts = {**DRUM, "hull/size": "0.18", "hull/fromto": "0 0 -0.1 0 0 0.1"}


@pytest.mark.parametrize(
    "parts",
    [
        {},
        CAPSULE,
        DRUM,
        {**DRUM, "hull/euler": "0.4 0 0"},
        FROMTO,
        {**FROMTO, "hull/type": "capsule"},
        {"motors": MOTORS},
    ],
    ids=["sphere", "capsule", "cylinder", "nearly upright", "fromto", "capsule fromto", "motors"],
)
def test_a_planar_base_is_read(tmp_path: Path, parts: Parts):
    robot = planar_robot(write_robot(tmp_path, parts))
    assert robot.actuators == 3
    assert robot.physics_steps == 10
    assert robot.masses[:2] == pytest.approx((2.0, 2.0))


def test_the_hull_reaches_as_far_as_its_farthest_disc(tmp_path: Path):
    arm = '<geom name="arm" size="0.1" pos="0.3 0 0.05" mass="1"/>'
    hull = planar_robot(write_robot(tmp_path, {"more": arm})).hull
    assert hull.radius_m == pytest.approx(0.4)
    assert (hull.low_m, hull.high_m) == pytest.approx((0.02, 0.38))
