"""Messages call a part of a robot by its name, or by where it stands in the file."""

import mujoco
import pytest

from tasks.simulate.application.robot_model import actuator_label, body_label, geom_label, joint_label

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
