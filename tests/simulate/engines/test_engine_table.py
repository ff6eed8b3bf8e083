"""Which engine runs which robot, and what is said of those that cannot."""

import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.devices import DeviceKind
from tasks.simulate.engines.engine_table import choose_engine
from tasks.simulate.host.declaration import ControllerKind

PLANAR = """<mujoco><option timestep="0.005" {option}/><worldbody><body name="b" pos="0 0 0.3">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="t" type="hinge" axis="0 0 1"/><geom name="hull" {geom} mass="1"/>{more}</body></worldbody>
<actuator><motor joint="x"/></actuator></mujoco>"""
BALL, BOX, DRUM = 'type="sphere" size="0.2"', 'type="box" size="0.2 0.2 0.1"', 'type="cylinder" size="0.2 0.1"'
ARM = '<body name="arm"><joint name="j"/><geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/></body>'
HAND = '<body name="hand" pos="0.3 0 0"><joint name="k"/><geom size="0.05"/></body></body>'
FREE = """<mujoco><worldbody><body name="b" pos="0 0 0.3"><freejoint/><geom name="hull" type="{geom}" size="0.2 0.1"/>
<body name="arm"><joint name="j"/><geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/></body></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
ROBOTS = {
    "ball": PLANAR.format(option="", geom=BALL, more=""),
    "box": PLANAR.format(option="", geom=BOX, more=""),
    "drum": PLANAR.format(option="", geom=DRUM, more=""),
    "armed ball": PLANAR.format(option="", geom=BALL, more=ARM),
    "boxes with a limit": PLANAR.format(option="", geom=BOX, more=ARM.replace('name="j"', 'name="j" range="-1 1"')),
    "armed ball that can hit itself": PLANAR.format(option="", geom=BALL, more=ARM.replace("</body>", HAND)),
    "implicit ball": PLANAR.format(option='integrator="implicit"', geom=BALL, more=""),
    "walker": FREE.format(geom="sphere"),
    "walking drum": FREE.format(geom="cylinder"),
}


def robot(folder: Path, name: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(ROBOTS[name])
    return path


@pytest.mark.parametrize(
    ("name", "on_cpu", "on_gpu"),
    [
        ("ball", "planar", "planar"),
        ("box", "mjx", "mjx"),
        ("boxes with a limit", "mujoco", "mjx"),
        ("drum", "planar", "planar"),
        ("implicit ball", "mujoco", "mujoco"),
        ("armed ball", "mujoco", "mjx"),
        ("armed ball that can hit itself", "mujoco", "mjx"),
        ("walker", "mujoco", "mjx"),
        ("walking drum", "mujoco", "mujoco"),
    ],
)
def test_auto_takes_the_fastest_engine_that_can(tmp_path: Path, name: str, on_cpu: str, on_gpu: str):
    devices: tuple[DeviceKind, DeviceKind] = ("cpu", "gpu")
    chosen = [choose_engine("auto", robot(tmp_path, name), "jax", device) for device in devices]
    assert [choice.engine for choice in chosen] == [on_cpu, on_gpu]


@pytest.mark.parametrize("engine", ["planar", "mjx", "mujoco"])
def test_the_engine_asked_for_is_taken_if_it_can(tmp_path: Path, engine: str):
    choice = choose_engine(engine, robot(tmp_path, "ball"), "jax", "cpu")
    assert (choice.engine, choice.why) == (engine, "asked for")


@pytest.mark.parametrize(
    ("engine", "name", "culprit"),
    [
        ("planar", "box", "geom 'hull'"),
        ("planar", "walker", "joint"),
        ("planar", "armed ball", "joint"),
        ("planar", "implicit ball", "option integrator implicit"),
        ("mjx", "walking drum", "geom 'hull': MJX cannot collide a cylinder with boxes: use a sphere"),
        ("mjx", "implicit ball", "option integrator implicit"),
    ],
)
def test_an_engine_that_cannot_says_what_is_in_the_way_and_the_remedy(
    tmp_path: Path, engine: str, name: str, culprit: str
):
    with pytest.raises(RobotRefused, match=f"(?s){culprit}.*set engine: .*mujoco"):
        choose_engine(engine, robot(tmp_path, name), "jax", "cpu")


# On commit 2fa7955b planar advised engine: auto, and the others drove it through walls.
@pytest.mark.parametrize("engine", ["auto", "planar", "mjx", "mujoco"])
def test_no_engine_takes_a_robot_without_contacts_or_advises_another(tmp_path: Path, engine: str):
    path = robot(tmp_path, "ball")
    path.write_text(path.read_text().replace("<option", '<option><flag contact="disable"/></option><option'))
    with pytest.raises(RobotRefused, match="option flag contact disable") as refused:
        choose_engine(engine, path, "jax", "cpu")
    assert "engine: " not in str(refused.value)


def test_why_names_what_stands_in_the_way_of_a_faster_engine(tmp_path: Path):
    chosen = {
        name: choose_engine("auto", robot(tmp_path, name), "jax", "cpu").why
        for name in ("ball", "drum", "box", "implicit ball", "walker", "boxes with a limit")
    }
    assert chosen == {
        "ball": "the fastest of all",
        "drum": "the fastest of all",
        "box": "the fastest for this robot: planar cannot represent geom 'hull'",
        "implicit ball": "the fastest for this robot: planar cannot represent option integrator implicit, "
        "mjx cannot represent option integrator implicit",
        "walker": "the fastest for this robot: planar cannot represent the 1st joint (free) of body 'b', "
        "joint 'j', mjx is slower: the floor holds it",
        "boxes with a limit": "the fastest for this robot: planar cannot represent joint 'j', "
        "mjx is slower: joint 'j' has a limit or friction",
    }


@pytest.mark.parametrize("kind", get_args(ControllerKind))
def test_the_kind_of_controller_does_not_decide_the_engine(tmp_path: Path, kind: ControllerKind):
    choice = choose_engine("auto", robot(tmp_path, "ball"), kind, "cpu")
    assert (choice.engine, choice.controller) == ("planar", kind)


def test_a_robot_is_judged_without_jax():
    code = "import sys, tasks.simulate.engines.engine_table; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
