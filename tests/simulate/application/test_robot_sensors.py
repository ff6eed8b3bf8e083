"""Cameras and sensors of a robot's file: the declarations that they are, beside MuJoCo's own; what is not taken."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from specs.bundle_files import DepthCameraDeclaration, ImuDeclaration, RangeFindersDeclaration
from tasks.render.camera_renderer import focal_px, mounted
from tasks.simulate.application.robot_file import read_file_sensors, read_robot_mjcf
from tasks.simulate.application.robot_model import compile_robot, resting

ROBOT = """<mujoco><worldbody>
<body name="base" pos="0 0 0.2">
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint name="yaw" type="hinge" axis="0 0 1"/>
<geom type="box" size="0.3 0.2 0.1" mass="2"/>
<body pos="0.1 0 0.3" euler="0 0 20"><geom size="0.01" mass="0.1"/>{fixed}</body>
<body name="arm" pos="0 0 0.3"><joint axis="0 0 1"/><geom size="0.01" mass="0.1"/>{arm}</body>
</body>{world}</worldbody><actuator><velocity joint="yaw"/></actuator><sensor>{sensors}</sensor></mujoco>"""
PARTS = ("fixed", "arm", "world", "sensors")
SITES = (
    '<site name="front" pos="0 0 0.1" euler="0 90 0"/><site name="left" pos="0 0 0.1" euler="-90 0 0"/>'
    '<site name="chip" pos="0.05 0 0" euler="0 0 10"/><site name="tilted" euler="5 0 0"/>'
)


def robot(folder: Path, **parts: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(ROBOT.format(**{**dict.fromkeys(PARTS, ""), **parts}))
    return path


@pytest.mark.parametrize(
    "camera",
    [
        'fovy="50" resolution="320 240" pos="0.05 0.02 0.1" xyaxes="0 -1 0 0.3 0 1"',
        'fovy="40" resolution="160 160" xyaxes="0 -1 0 1 0 0"',
        'focal="0.004 0.004" sensorsize="0.006 0.0045" resolution="400 300" xyaxes="1 0 0 0 0 1"',
    ],
)
def test_a_camera_looks_where_mujocos_does(camera: str, tmp_path: Path):
    path = robot(tmp_path, fixed=f'<camera name="eye" {camera}/>')
    declared = DepthCameraDeclaration.model_validate(read_file_sensors(path).found["camera"]["eye"])
    model = compile_robot(read_robot_mjcf(path))
    data = resting(model)
    mujoco.mj_camlight(model, data)
    turn, pose = data.cam_xmat[0].reshape(3, 3), mounted(declared, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(pose.position_m, data.cam_xpos[0], atol=2e-6)
    np.testing.assert_allclose([pose.ahead, pose.up], [-turn[:, 2], turn[:, 1]], atol=2e-6)
    assert (declared.columns, declared.rows) == tuple(model.cam_resolution[0])
    high = 2 * np.arctan(declared.rows / 2 / focal_px(declared))
    assert np.degrees(high) == pytest.approx(model.cam_fovy[0], abs=1e-4)


def test_a_camera_that_says_no_resolution_has_the_usual_one_and_a_larger_one_is_made_smaller(tmp_path: Path):
    level = 'xyaxes="0 -1 0 0 0 1"'
    both = f'<camera name="bare" {level}/><camera name="fine" resolution="1920 1080" {level}/>'
    found = read_file_sensors(robot(tmp_path, fixed=both)).found["camera"]
    assert [(each["columns"], each["rows"]) for each in (found["bare"], found["fine"])] == [(64, 48), (640, 360)]


def test_gyro_and_accelerometer_of_a_site_are_an_imu(tmp_path: Path):
    both = '<gyro site="chip" noise="0.01"/><accelerometer site="chip" noise="0.2"/>'
    found = read_file_sensors(robot(tmp_path, fixed=SITES, sensors=both)).found["imu"]
    imu = ImuDeclaration.model_validate(found["chip"])
    turn = np.radians(20)
    place = (0.1 + 0.05 * np.cos(turn), 0.05 * np.sin(turn), 0.3)
    assert (imu.x_m, imu.y_m, imu.z_m) == pytest.approx(place, abs=2e-6)
    assert imu.yaw_rad == pytest.approx(np.radians(30), abs=2e-6)
    assert (imu.gyro_sigma_rad_s, imu.force_sigma_m_s2) == (0.01, 0.2)


def test_a_range_finder_looks_along_its_site(tmp_path: Path):
    level = '<site name="front" pos="-0.043969 0.034202 0" euler="0 90 0"/>'
    (found,) = (
        read_file_sensors(
            robot(tmp_path, fixed=level, sensors='<rangefinder name="sonar" site="front" cutoff="3" noise="0.01"/>')
        )
        .found["rangefinder"]
        .items()
    )
    finder = RangeFindersDeclaration.model_validate(found[1])
    assert found[0] == "sonar"
    assert (finder.finders, finder.range_m, finder.sigma_m, finder.z_m) == (1, 3.0, 0.01, 0.5)
    assert finder.out_m == pytest.approx(0.05, abs=1e-4)
    assert finder.first_rad == pytest.approx(np.radians(20), abs=2e-6)


@pytest.mark.parametrize(
    ("parts", "line"),
    [
        (
            {"fixed": '<camera name="a" xyaxes="0 -1 0.3 0 0.3 1"/>'},
            "camera 'a' (line 5) is not taken: it is rolled by 0.291 rad; pictures here have a level horizon",
        ),
        (
            {"fixed": '<camera name="a" xyaxes="0 1 0 0 0 -1"/>'},
            "camera 'a' (line 5) is not taken: it is upside down; pictures here have a level horizon",
        ),
        (
            {"arm": '<camera name="a"/>'},
            "camera 'a' (line 6) is not taken: it is not fixed to the base, but to what moves, or to the world",
        ),
        (
            {"world": '<camera name="a"/>'},
            "camera 'a' (line 7) is not taken: it is not fixed to the base, but to what moves, or to the world",
        ),
        ({"fixed": '<camera name="a" mode="track"/>'}, "camera 'a' (line 5) is not taken: its mode is not fixed"),
        (
            {"fixed": "<camera/>"},
            "camera '' (line 5) is not taken: nothing can ask for it: it has no name, nor has its site",
        ),
        (
            {"fixed": SITES, "sensors": '<gyro site="tilted"/>'},
            "imu of site 'tilted', <gyro> (line 7), is not taken: its site is tilted; an IMU here is turned "
            "counter-clockwise alone",
        ),
        (
            {"fixed": SITES, "sensors": '<rangefinder site="chip"/>'},
            "rangefinder 'chip' (line 7) is not taken: its site's z axis, along which it looks, is not level",
        ),
        (
            {"fixed": SITES, "sensors": '<rangefinder site="left"/>'},
            "rangefinder 'left' (line 7) is not taken: it does not look away from the base's axis",
        ),
        (
            {"sensors": '<jointpos name="p" joint="yaw"/><jointpos joint="yaw"/>'},
            "<jointpos> 'p' (line 7) and 1 more: not taken: no sensor here tells that",
        ),
        (
            {"fixed": '<camera name="a" xyaxes="0 -1 0 0 0 1"/>'},
            "camera 'a' (line 5) has no effect unless a depth_camera or color_camera says `mjcf: a`",
        ),
    ],
)
def test_what_is_not_taken_is_named(parts: dict[str, str], line: str, tmp_path: Path):
    assert read_file_sensors(robot(tmp_path, **parts)).lines == (f"robot.xml: {line}",)
