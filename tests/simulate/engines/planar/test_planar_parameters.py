"""Every parameter is read from the robot's file: robots that differ from the courier in many move just as in C MuJoCo.

That a robot would move otherwise without one of its parameters is tested too, on C: so none could be a constant.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.factories.planar import (
    CAPSULE,
    LOAD,
    MOTORS,
    NO_CYLINDERS,
    ROUGH,
    Obstacles,
    Parts,
    among,
    both,
    box,
    drive_c,
    write_robot,
)

pytestmark = pytest.mark.long

STEPS = 16
WALL = Obstacles(np.array([box(0.35, 0.0, 0.1, 2.0, yaw=0.2)]), NO_CYLINDERS)
START = [0.0, 0.0, 0.3]
SPRINGY = """<position joint="x" kp="30" kv="5"/><position joint="y" kp="20" kv="4" forcerange="-2 2"/>
    <position joint="yaw" kp="1" kv="0.2"/>"""
CROOKED = """<general site="drive" gear="1 0.3 0 0 0 0.1" gainprm="8" biastype="affine" biasprm="0.5 0 -6"/>
    <general joint="y" gainprm="2 -3 0.5" gaintype="affine" biastype="affine" biasprm="0 -3 -1"/><motor joint="yaw"/>"""
LAGGING = """<general joint="x" dyntype="filter" dynprm="0.1" gainprm="5" actearly="EARLY"/>
    <general joint="y" dyntype="integrator" gainprm="9" actlimited="true" actrange="-0.05 0.05"/>
    <general joint="yaw" dyntype="filterexact" dynprm="0.2" gainprm="1" actearly="EARLY"/>"""
DAMPED: Parts = {"x/damping": "9", "y/damping": "4", "yaw/damping": "0.2"}
ARM = '<geom name="arm" size="0.05" pos="0.16 -0.08 0" mass="0.1" condim="1"/>'
# Robots, each with what sets it apart: parameter by parameter.
ROBOTS: dict[str, dict[str, Parts]] = {
    "soft": {
        "mass": {"hull/mass": "5"},
        "radius": {"hull/size": "0.16"},
        "condim": {"hull/condim": "3"},
        "friction": {"hull/friction": "0.7"},
        "solref": {"hull/solref": "0.05 0.6"},
        "solimp": {"hull/solimp": "0.5 0.8 0.01 0.3 3"},
        "margin": {"hull/margin": "0.02", "hull/gap": "0.01"},
        "timestep": {"option/timestep": "0.01"},
    },
    "hard": {
        "rough": ROUGH,
        "solref as stiffness": {"hull/solref": "-2000 -30"},
        "solimp with a linear rise": {"hull/solimp": "0.6 0.9 0.02 0.5 1"},
        "solmix": {"hull/solmix": "5"},
        "impratio": {"option/impratio": "6"},
    },
    "two discs": {
        "rough": ROUGH,
        "capsule": CAPSULE,
        "hull ahead": {"hull/pos": "0.05 0.02 0"},
        "arm": {"more": ARM},
    },
    "heavy": {
        "load": {"more": LOAD},
        "damping": DAMPED,
        "friction of joints": {"x/frictionloss": "2", "y/frictionloss": "1", "yaw/frictionloss": "0.05"},
        "armature": {"x/armature": "3", "y/armature": "0.5", "yaw/armature": "0.1"},
        "force limits": {"x/actuatorfrcrange": "-3 3", "yaw/actuatorfrcrange": "-0.02 0.02"},
    },
    "explicitly damped": {"damping": DAMPED, "flag": {"flag/eulerdamp": "disable"}},
    "implicitfast": {"integrator": {"option/integrator": "implicitfast"}, "damping": DAMPED},
    "implicitfast, heavy": {
        "integrator": {"option/integrator": "implicitfast"},
        "load": {"more": LOAD},
        "rough": ROUGH,
    },
    "unclamped": {"flag": {"flag/clampctrl": "disable"}},
    "geared": {"motors": {"motors": MOTORS.replace("/>", ' gear="0.7"/>')}},
    "position-controlled": {"motors": {"motors": SPRINGY}},
    "crooked": {"motors": {"motors": CROOKED}},
    "lagging": {"motors": {"motors": LAGGING.replace("EARLY", "false")}},
    "lagging less": {"motors": {"motors": LAGGING.replace("EARLY", "true")}},
}

# Each robot is a program of its own to compile; these have most of the parameters.
_QUICK = ("soft", "two discs", "lagging")


def controls() -> np.ndarray:
    """Returns a drive against the wall and along it, beyond the control's limits."""
    time = np.arange(STEPS)
    return np.stack([1.2 + 0.0 * time, 1.5 * np.sin(time / 4), 0.2 * np.cos(time / 3)], axis=1)


def assembled(*parameters: Parts) -> Parts:
    """Returns a robot that has all of these."""
    return {key: value for parameter in parameters for key, value in parameter.items()}


@pytest.mark.parametrize(
    "robot", [name if name in _QUICK else pytest.param(name, marks=pytest.mark.long) for name in ROBOTS]
)
def test_a_robot_moves_as_in_c(tmp_path: Path, robot: str):
    motion, theirs = both(write_robot(tmp_path, assembled(*ROBOTS[robot].values())), WALL, START, controls())
    np.testing.assert_allclose(motion.body.qpos, theirs.pose, atol=3e-6)
    np.testing.assert_allclose(motion.body.qvel, theirs.velocity, atol=1e-4)


@pytest.mark.parametrize(("robot", "parameter"), [(robot, each) for robot, parts in ROBOTS.items() for each in parts])
def test_without_a_parameter_it_would_be_elsewhere(tmp_path: Path, robot: str, parameter: str):
    others = [parts for name, parts in ROBOTS[robot].items() if name != parameter]
    start = np.array(START)
    complete = drive_c(among(write_robot(tmp_path, assembled(*ROBOTS[robot].values())), WALL), start, controls())
    without = drive_c(among(write_robot(tmp_path, assembled(*others)), WALL), start, controls())
    assert np.abs(complete.pose - without.pose).max() > 1e-4
