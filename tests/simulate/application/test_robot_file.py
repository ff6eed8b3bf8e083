"""A robot's file that takes away what the robot is judged by is refused; what is only strange is said."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.harness import markdown, with_tables
from tasks.simulate.application.mjcf_check import RobotRefused, refusal_lines
from tasks.simulate.application.robot_file import RULES, read_robot_mjcf, strange_in_robot
from tasks.simulate.application.robot_model import add_obstacle, compile_robot
from tests.factories.simulations import ROOT_ROBOTS
from tests.repository import ROOT

PLANAR = """<mujoco>{top}<option {option}>{flags}</option><default><geom {default}/></default><worldbody>{world}
<body name="base" pos="0 0 0.2">
<joint name="x" type="slide" axis="1 0 0" {x}/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="yaw" type="hinge" axis="0 0 1" {yaw}/><geom name="hull" type="sphere" size="0.18" mass="2" {hull}/>{inside}
<site name="drive"/></body></worldbody>{more}
<actuator><velocity site="drive" gear="1 0 0 0 0 0" kv="40"/></actuator></mujoco>"""
FREE = """<mujoco>{top}<option {option}>{flags}</option><worldbody>
<geom name="ground" type="plane" size="0 0 1" {floor}/>
<body name="base" pos="0 0 {z}" {base}><freejoint/><geom name="hull" type="box" size="0.2 0.15 0.1" mass="4"/>
<body name="arm" gravcomp="{arm}"><joint name="a"/><geom size="0.02" mass="1"/></body></body></worldbody>{more}
<actuator><motor joint="a"/></actuator></mujoco>"""
_BLANKS = dict.fromkeys(
    ("top", "option", "flags", "default", "world", "x", "yaw", "hull", "inside", "more", "floor", "base"), ""
)


def planar(folder: Path, **changes: str) -> Path:
    return _written(folder, PLANAR, changes)


def free(folder: Path, **changes: str) -> Path:
    return _written(folder, FREE, {"z": "0.1", "arm": "0", **changes})


def _written(folder: Path, form: str, changes: dict[str, str]) -> Path:
    path = folder / "robot.xml"
    path.write_text(form.format(**{**_BLANKS, **changes}))
    return path


def _flag(name: str, value: str = "disable") -> dict[str, str]:
    return {"flags": f'<flag {name}="{value}"/>'}


# Each let a robot pass through walls, or kept it away from them, on commit 2fa7955b.
@pytest.mark.parametrize(
    ("changes", "culprit"),
    [
        (_flag("contact"), "option flag contact disable"),
        (_flag("constraint"), "option flag constraint disable"),
        (_flag("actuation"), "option flag actuation disable"),
        (_flag("sensor"), "option flag sensor disable"),
        (_flag("override", "enable"), "option flag override enable"),
        ({"option": 'actuatorgroupdisable="0"'}, "option actuatorgroupdisable"),
        ({"option": 'gravity="5 0 -9.81"'}, "option gravity 5 0 -9.81"),
        ({"option": 'density="1000"'}, "option density 1000"),
        ({"option": 'viscosity="1"'}, "option density 0, viscosity 1"),
        ({"option": 'wind="1 0 0"'}, "option wind 1 0 0"),
        ({"option": 'iterations="0"'}, "option iterations 0 of solver newton"),
        ({"option": 'iterations="1" solver="PGS"'}, "option iterations 1 of solver pgs"),
        ({"option": 'ccd_iterations="1"'}, "option ccd_iterations 1"),
        ({"option": 'tolerance="1"'}, "option tolerance 1"),
        ({"top": '<compiler settotalmass="0.001"/>'}, "a mass of 0.001 kg in all"),
        ({"top": '<size memory="2K"/>'}, "size memory 2,048 bytes"),
        ({"hull": 'margin="-1"'}, "geom 'hull': margin -1"),
        ({"hull": 'gap="-0.5"'}, "geom 'hull': gap -0.5"),
        ({"hull": 'solref="100 1"'}, "geom 'hull': solref 100 1"),
        ({"hull": 'solref="0.02 100"'}, "geom 'hull': solref 0.02 100"),
        ({"hull": 'solref="-0.1 -1"'}, "geom 'hull': solref -0.1 -1"),
        ({"hull": 'solimp="0.0001 0.9 1"'}, "geom 'hull': solimp 0.0001 0.9 1"),
        ({"default": 'margin="-1"', "hull": 'margin="0"'}, "default geom: margin -1"),
        ({"more": '<contact><exclude body1="base" body2="world"/></contact>'}, "contact exclude of body 'base'"),
        ({"x": 'range="-0.5 0.5" limited="true"'}, "joint 'x': range -0.5 0.5"),
        ({"x": 'ref="1"'}, "joint 'x': ref 1"),
        ({"yaw": 'pos="0.1 0 0"'}, "joint 'yaw': pos 0.1 0 0"),
        ({"x": 'stiffness="9"'}, "joint 'x': stiffness 9"),
        ({"more": '<equality><weld name="w" body1="base"/></equality>'}, r"equality w \(weld\)"),
        ({"more": '<equality><joint joint1="x"/></equality>'}, r"equality 1 \(joint\)"),
        (
            {
                "world": '<site name="wall"/>',
                "more": '<tendon><spatial name="rope" range="0 1" limited="true"><site site="wall"/>'
                '<site site="drive"/></spatial></tendon>',
            },
            "tendon rope",
        ),
        ({"hull": 'pos="0 0 5"'}, "the hull is from 5.02 to 5.38 m above the floor"),
        ({"hull": 'pos="0 0 -1"'}, "the hull is from -0.98 to -0.62 m above the floor"),
        ({"inside": '<geom name="body" size="0.5" contype="0" conaffinity="0"/>'}, "geom 'body' reaches 0.5 m"),
    ],
)
def test_what_takes_away_what_a_planar_base_is_judged_by_is_refused(
    tmp_path: Path, changes: dict[str, str], culprit: str
):
    with pytest.raises(RobotRefused, match=rf"robot\.xml: {culprit}.*: .*: \w+") as refused:
        read_robot_mjcf(planar(tmp_path, **changes))
    assert "engine" not in str(refused.value), "no other engine helps"


@pytest.mark.parametrize(
    ("changes", "culprit"),
    [
        (_flag("gravity"), "option flag gravity disable"),
        ({"option": 'gravity="0 0 0"'}, "option gravity 0 0 0"),
        ({"option": 'gravity="0 0 9.81"'}, "option gravity 0 0 9.81"),
        ({"base": 'gravcomp="1"'}, "gravcomp of body 'base': 80 % of the robot's weight"),
        ({"floor": 'margin="-1"'}, "the floor: margin -1"),
        ({"floor": 'solref="100 1"'}, "the floor: solref 100 1"),
        ({"floor": 'margin="0.3"'}, "the floor, or a spring, throws the robot .* m up at the start"),
        ({"z": "-0.06"}, "the floor, or a spring, throws the robot .* m up at the start"),
        ({"z": "5"}, "the hull is from 4.9 to 5.1 m above the floor"),
        ({"more": '<contact><exclude body1="base" body2="world"/></contact>'}, "contact exclude of body 'base'"),
        ({"more": '<equality><weld body1="base"/></equality>'}, r"equality 1 \(weld\)"),
    ],
)
def test_what_takes_away_what_a_free_base_is_judged_by_is_refused(
    tmp_path: Path, changes: dict[str, str], culprit: str
):
    with pytest.raises(RobotRefused, match=rf"robot\.xml: .*{culprit}.*: .*: \w+"):
        read_robot_mjcf(free(tmp_path, **changes))


def test_all_of_it_is_said_at_once(tmp_path: Path):
    path = planar(tmp_path, **_flag("contact"), option='wind="1 0 0"', x='stiffness="9"')
    with pytest.raises(RobotRefused) as refused:
        read_robot_mjcf(path)
    assert len(refusal_lines(str(refused.value))) == 3


@pytest.mark.parametrize("name", ["simyard/floor", "solid/wall"])
def test_a_part_with_a_name_of_simyards_own_is_refused(tmp_path: Path, name: str):
    path = planar(tmp_path)
    path.write_text(path.read_text().replace('name="hull"', f'name="{name}"'))
    with pytest.raises(RobotRefused, match=f"name '{name}': .*: give it another"):
        read_robot_mjcf(path)


@pytest.mark.parametrize("default", ['euler="0 90 0"', 'mesh="tiny"', 'fromto="0 0 0 0 0 1"', 'quat="0.7 0.7 0 0"'])
def test_a_default_of_the_robots_file_neither_moves_nor_shapes_an_obstacle(tmp_path: Path, default: str):
    tiny = '<asset><mesh name="tiny" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>'
    path = planar(tmp_path, top=tiny, default=default)
    path.write_text(path.read_text().replace('type="sphere" size="0.18"', 'type="capsule" size="0.18 0.1"'))
    spec = read_robot_mjcf(path)
    wall = add_obstacle(spec, "wall", mujoco.mjtGeom.mjGEOM_BOX, (1, 1))
    wall.pos, wall.size = [3.0, 0.0, 1.0], [0.1, 2.0, 1.0]
    made = compile_robot(spec).geom("wall")
    np.testing.assert_allclose(np.concatenate([made.pos, made.size, made.quat]), [3, 0, 1, 0.1, 2, 1, 1, 0, 0, 0])


@pytest.mark.parametrize("path", ROOT_ROBOTS, ids=lambda path: path.parent.name)
def test_nothing_is_strange_about_the_robots_that_simyard_brings_along(path: Path):
    read_robot_mjcf(path)
    assert strange_in_robot(path) == ()


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (_flag("limit"), "option flag limit disable"),
        ({"option": 'gravity="0 0 -1.6"'}, "option gravity 0 0 -1.6: on earth it is 0 0 -9.81"),
        ({"arm": "1"}, "body 'arm' has gravcomp 1"),
    ],
)
def test_what_is_only_strange_is_said(tmp_path: Path, changes: dict[str, str], line: str):
    path = free(tmp_path, **changes)
    read_robot_mjcf(path)
    assert strange_in_robot(path) == (line,)


def test_of_cameras_and_sensors_of_the_file_it_is_said_how_they_have_an_effect(tmp_path: Path):
    path = planar(tmp_path, inside='<camera name="front"/><site name="imu"/>')
    sensor = '<sensor><gyro site="imu"/></sensor>'
    path.write_text(path.read_text().replace("</actuator>", f"</actuator>{sensor}"))
    assert strange_in_robot(path) == (
        "robot.xml: camera 'front' (line 4) has no effect unless a depth_camera or color_camera says `mjcf: front`",
        "robot.xml: imu of site 'imu', <gyro> (line 6), has no effect unless an imu says `mjcf: imu`",
    )


def test_a_motor_that_is_switched_off_is_strange(tmp_path: Path):
    path = planar(tmp_path, option='actuatorgroupdisable="1"')
    path.write_text(path.read_text().replace("</actuator>", '<motor name="b" joint="x" group="1"/></actuator>'))
    assert strange_in_robot(path) == ("actuator 'b' is disabled by option actuatorgroupdisable",)


def test_a_robot_that_is_seen_beyond_its_hull_is_strange(tmp_path: Path):
    path = planar(tmp_path, inside='<geom name="mast" size="0.25" contype="0" conaffinity="0"/>')
    (line,) = strange_in_robot(path)
    assert line.startswith("geom 'mast' reaches 0.25 m from its axis, and what collides 0.18 m")


def test_a_wheel_jammed_in_its_own_chassis_is_named(tmp_path: Path):
    wheel = '<body name="wheel"><joint/><geom name="wheel" size="0.05" mass="1"/></body>'
    fork = f'<body name="fork"><joint/><geom size="0.01" pos="0 0 0.5" mass="1"/>{wheel}</body>'
    (line,) = strange_in_robot(planar(tmp_path, inside=fork))
    assert re.fullmatch(
        "geom 'hull' and geom 'wheel' overlap by \\d+ mm at the start, and push each other apart: .*", line
    )


def test_the_guide_has_the_list_with_its_reasons():
    guide = (ROOT / "docs/guide/robots.md").read_text()
    rules = [[rule.what, rule.why, rule.allowed] for rule in RULES]
    assert with_tables(guide, "refused", markdown([["refused", "because", "instead"], *rules])) == guide
