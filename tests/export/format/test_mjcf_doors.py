"""A door turns about its hinge from shut to open, stands as the world says, and stays where it is left."""

import math

import mujoco
import numpy as np
import pytest

from tasks.export.format.mjcf import HINGE_SUFFIX, mjcf_files, world_spec
from tests.export.variants import DOOR, HINGE_M, LEAF_LENGTH_M, LEAF_THICKNESS_M, with_door

HINGE = DOOR + HINGE_SUFFIX


def stepped(percent: float, opening_rad: float | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns the model of a door that stands at a percentage, and its state: as it stands, or opened as given."""
    model = world_spec(with_door(percent)).compile()
    data = mujoco.MjData(model)
    if opening_rad is not None:
        data.joint(HINGE).qpos[0] = opening_rad
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("percent", [0.0, 37.5, 100.0])
def test_the_hinge_begins_at_the_opening_and_the_leaf_stands_as_the_world_says(percent: float):
    model, data = stepped(percent)
    leaf = with_door(percent).doors[0].leaf
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 2 * percent / 100.0)
    np.testing.assert_allclose(data.geom(DOOR).xpos, leaf.center_m, atol=1e-9)
    assert model.geom(DOOR).size == pytest.approx(leaf.half_extents_m)


@pytest.mark.parametrize("percent", [0.0, 37.5, 100.0])
@pytest.mark.parametrize(
    ("opening_rad", "center_m"),
    [
        (0.0, (HINGE_M[0] + LEAF_THICKNESS_M / 2, HINGE_M[1] + LEAF_LENGTH_M / 2)),
        (math.pi / 2, (HINGE_M[0] + LEAF_LENGTH_M / 2, HINGE_M[1] - LEAF_THICKNESS_M / 2)),
    ],
)
def test_the_hinge_at_its_ends_is_shut_and_fully_open(
    percent: float, opening_rad: float, center_m: tuple[float, float]
):
    _, data = stepped(percent, opening_rad)
    np.testing.assert_allclose(data.geom(DOOR).xpos[:2], center_m, atol=1e-9)


def test_the_hinge_goes_from_shut_to_a_quarter_turn():
    model, _ = stepped(50.0)
    assert model.jnt_limited[model.joint(HINGE).id]
    np.testing.assert_allclose(model.joint(HINGE).range, [0.0, math.pi / 2])


@pytest.mark.parametrize("opening_rad", np.linspace(0.0, math.pi / 2, 7))
def test_the_leaf_touches_nothing_at_any_opening(opening_rad: float):
    _, data = stepped(0.0, opening_rad)
    assert data.ncon == 0


def test_a_door_that_nobody_touches_stays_and_one_that_is_pushed_moves():
    model, data = stepped(50.0)
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 4, abs=1e-3)
    data.joint(HINGE).qfrc_applied[0] = 1.0  # a draught
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 4, abs=0.02)
    data.joint(HINGE).qfrc_applied[0] = 8.0  # 10 N at the handle
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] > math.pi / 4 + 0.2


def test_a_leaf_weighs_what_a_door_weighs():
    model, _ = stepped(0.0)
    assert 15.0 < model.body(DOOR).mass[0] < 30.0


def test_the_exported_document_keeps_the_hinge():
    files = mjcf_files(with_door(25.0))
    model = mujoco.MjModel.from_xml_string(files.pop("world.xml").decode(), files)
    assert model.qpos0[0] == pytest.approx(math.pi / 8, abs=1e-5)
