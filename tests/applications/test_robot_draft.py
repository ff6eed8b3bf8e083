"""A robot's description becomes files that Simyard reads, and a base that drives as its plugin says."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely
import trimesh

from specs.errors import LaunchRefused
from specs.ros_robot import DifferentialDrive, DraftRequest, RobotDraft, RosImu, RosRobot, VelocityDrive
from tasks.applications.robot_draft import draft_robot
from tasks.simulate.host.declaration import read_ros_robot
from tasks.simulate.host.twist_drive import twist_map
from tests.repository import ROOT

ROVER = (ROOT / "examples/ros/gazebo/rover_sim/urdf/rover.urdf").read_text()
_FINDINGS = (
    "<sensor name='eye' type='camera'> of eye: <update_rate> 30: it is 20",
    "joints do not move, and /joint_states lacks them: left_joint, right_joint",
    "<plugin name='truth' filename='libgazebo_ros_p3d.so'> is not taken: the true pose is on no topic of its own "
    "(truth)",
)


def drafted(text: str, bundle: Path) -> RobotDraft:
    return draft_robot(DraftRequest(bundle=bundle, description=text))


def declared(draft: RobotDraft, folder: Path) -> RosRobot:
    (folder / "ros.yaml").write_text(draft.ros_yaml)
    return read_ros_robot(folder)


def simple(plugin: str, shape: str = '<box size="0.6 0.4 0.2"/>', more: str = "") -> str:
    return (
        '<robot name="cart"><link name="base"><inertial><mass value="10"/>'
        '<inertia ixx="0.3" iyy="0.3" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial>'
        f"<collision><geometry>{shape}</geometry></collision></link>{more}<gazebo>{plugin}</gazebo></robot>"
    )


def hull(draft: RobotDraft) -> shapely.Polygon:
    """Returns what the discs of a draft cover."""
    model = mujoco.MjModel.from_xml_string(draft.robot_xml)
    discs = zip(model.geom_pos, model.geom_size, strict=True)
    covered = shapely.union_all([shapely.Point(place[:2]).buffer(size[0]) for place, size in discs])
    assert isinstance(covered, shapely.Polygon)
    return covered


def test_topics_frames_and_lidar_are_the_plugins(tmp_path: Path):
    draft = drafted(ROVER, tmp_path)
    found = declared(draft, tmp_path)
    assert (found.topics.command, found.topics.scan, found.topics.odometry) == ("/cmd_vel", "/scan", "/odom")
    assert (found.topics.imu, found.topics.bumper) == ("/imu", None)
    assert (found.frames.base, found.frames.laser, found.frames.imu) == ("base_footprint", "laser", "base_link")
    assert found.drive == DifferentialDrive(track_m=0.16)
    assert found.lidar is not None
    assert (found.lidar.rays, found.lidar.range_m, found.lidar.sigma_m) == (360, 3.5, 0.01)
    assert (found.lidar.height_m, found.lidar.x_m, found.lidar.fov_rad) == (0.18, -0.03, 2 * math.pi)
    assert found.lidar.rate_hz == 5.0
    assert found.imu == RosImu(z_m=0.01, heading=True)
    assert found.color_camera is not None
    assert (found.color_camera.columns, found.color_camera.rows, found.topics.color_image) == (
        320,
        240,
        "/camera/color/image_raw",
    )


def test_what_is_not_taken_is_named_with_its_tag(tmp_path: Path):
    assert drafted(ROVER, tmp_path).findings == _FINDINGS


def test_mass_and_hull_are_those_of_all_links(tmp_path: Path):
    draft = drafted(ROVER, tmp_path)
    model = mujoco.MjModel.from_xml_string(draft.robot_xml)
    assert model.body_mass.sum() == pytest.approx(0.865)
    covered = hull(draft)
    for x, y in ((-0.119, 0.0), (0.059, 0.0), (0.032, 0.088), (-0.03, -0.089)):
        assert covered.contains(shapely.Point(x, y))
    assert covered.bounds == pytest.approx((-0.12, -0.09, 0.06, 0.09), abs=0.02)


@pytest.mark.parametrize(("ahead_m_s", "turn_rad_s"), [(0.2, 0.0), (0.2, 0.5), (0.0, 1.0), (-0.1, 0.4)])
def test_it_drives_as_the_plugins_kinematics_say(tmp_path: Path, ahead_m_s: float, turn_rad_s: float):
    draft = drafted(ROVER, tmp_path)
    (tmp_path / "robot.xml").write_text(draft.robot_xml)
    twists = twist_map(tmp_path / "robot.xml", declared(draft, tmp_path).drive)
    model = mujoco.MjModel.from_xml_string(draft.robot_xml)
    data, poses = mujoco.MjData(model), list[tuple[float, float, float]]()
    for _ in range(100):
        data.ctrl[:] = twists.controls(np.array([[ahead_m_s, 0.0, turn_rad_s]]), data.qpos[2:3])[0]
        mujoco.mj_step(model, data, 10)
        poses.append((data.qpos[0], data.qpos[1], data.qpos[2]))
    begun, ended = np.array(poses[39]), np.array(poses[99])
    drove_m, turned_rad = ahead_m_s * 3.0, turn_rad_s * 3.0
    chord_m = drove_m * np.sinc(turned_rad / 2 / math.pi)
    assert ended[2] - begun[2] == pytest.approx(turned_rad, rel=0.02, abs=1e-3)
    assert math.dist(begun[:2], ended[:2]) == pytest.approx(abs(chord_m), rel=0.02, abs=1e-3)


def test_a_box_is_covered_by_discs_along_its_rim(tmp_path: Path):
    plugin = '<plugin name="m" filename="libgazebo_ros_planar_move.so"/>'
    covered = hull(drafted(simple(plugin), tmp_path))
    box = shapely.box(-0.3, -0.2, 0.3, 0.2)
    assert covered.exterior.distance(box.centroid) >= 0.2
    assert box.exterior.difference(covered).length == pytest.approx(0.0)
    assert box.buffer(0.05).contains(covered)


def test_a_mesh_of_the_bundle_counts_and_one_that_is_not_there_is_named(tmp_path: Path):
    (tmp_path / "cart").mkdir()
    (tmp_path / "cart/package.xml").write_text("<package><name>cart</name></package>")
    trimesh.creation.box((400.0, 200.0, 100.0)).export(tmp_path / "cart/hull.stl")
    scaled = '<mesh filename="package://cart/{}" scale="0.001 0.001 0.001"/>'
    plugin = '<plugin name="m" filename="libgazebo_ros_planar_move.so"/>'
    found = drafted(simple(plugin, scaled.format("hull.stl")), tmp_path)
    assert hull(found).bounds == pytest.approx((-0.2, -0.1, 0.2, 0.1), abs=0.03)
    with pytest.raises(LaunchRefused, match="no link of the robot's description has a collision"):
        drafted(simple(plugin, scaled.format("gone.stl")), tmp_path)


def test_a_holonomic_base_is_driven_sideways_too(tmp_path: Path):
    plugin = '<plugin name="m" filename="libgazebo_ros_planar_move.so"><commandTopic>go</commandTopic></plugin>'
    draft = drafted(simple(plugin), tmp_path)
    found = declared(draft, tmp_path)
    assert (found.topics.command, found.drive) == ("/go", VelocityDrive(sideways="sideways"))
    assert found.lidar is None
    (tmp_path / "robot.xml").write_text(draft.robot_xml)
    assert twist_map(tmp_path / "robot.xml", found.drive).controls(np.array([[0.1, 0.2, 0.3]]), np.zeros(1)).shape == (
        1,
        3,
    )


_MOVES = '<plugin name="m" filename="libgazebo_ros_planar_move.so"/>'


def with_sensors(*sensors: str) -> str:
    """Returns a robot whose sensors are on a link 0.1 m ahead, 0.5 m above its first one, turned down by 0.3."""
    mast = (
        '<link name="mast"/><joint name="up" type="fixed"><parent link="base"/><child link="mast"/>'
        '<origin xyz="0.1 0 0.5" rpy="0 0.3 0"/></joint>'
    )
    return simple(_MOVES, more=f'{mast}<gazebo reference="mast">{"".join(sensors)}</gazebo>')


def test_a_kinect_becomes_a_depth_and_a_colour_camera(tmp_path: Path):
    kinect = (
        '<sensor name="kinect" type="depth"><update_rate>10</update_rate><camera><horizontal_fov>1.05</horizontal_fov>'
        "<image><width>1280</width><height>960</height></image><clip><near>0.1</near><far>9</far></clip></camera>"
        '<plugin name="k" filename="libgazebo_ros_openni_kinect.so"><cameraName>front</cameraName>'
        "<depthImageTopicName>depth/image_rect</depthImageTopicName><pointCloudTopicName>/cloud</pointCloudTopicName>"
        "<pointCloudCutoffMax>4.5</pointCloudCutoffMax><frameName>front_optical</frameName></plugin></sensor>"
    )
    draft = drafted(with_sensors(kinect), tmp_path)
    found = declared(draft, tmp_path)
    depth, color = found.depth_camera, found.color_camera
    assert depth is not None
    assert color is not None
    assert (depth.columns, depth.rows, depth.fov_rad, depth.rate_hz) == (640, 480, 1.05, 10.0)
    assert (depth.range_m, color.range_m) == (4.5, 9.0)
    assert (depth.x_m, depth.z_m, depth.pitch_rad) == (0.1, 0.6, 0.3), "the floor is 0.1 m below its first link"
    assert (found.topics.depth_image, found.topics.depth_points) == ("/front/depth/image_rect", "/cloud")
    assert (found.topics.color_image, found.topics.color_info) == ("/front/image_raw", "/front/camera_info")
    assert (found.frames.depth_camera, found.frames.color_camera) == ("front_optical", "front_optical")
    assert "<sensor name='kinect' type='depth'> of mast: <image> 1280 x 960: 640 x 480 are taken" in draft.findings


def kinect(name: str, width: int = 64, frame: str = "") -> str:
    return (
        f'<sensor name="{name}" type="depth"><camera><image><width>{width}</width><height>48</height></image></camera>'
        f'<plugin name="{name}" filename="libgazebo_ros_openni_kinect.so"><cameraName>{name}</cameraName>'
        f"<frameName>{frame or name + '_optical'}</frameName></plugin></sensor>"
    )


def test_cameras_that_are_alike_become_a_list_with_the_topics_that_they_have(tmp_path: Path):
    found = declared(drafted(with_sensors(kinect("front"), kinect("rear")), tmp_path), tmp_path)
    topics, frames = found.topics, found.frames
    for first, image, points in (
        (found.depth_camera, "depth/image_raw", topics.depth_points),
        (found.color_camera, "image_raw", None),
    ):
        assert first is not None
        assert [each.name for each in first.every] == ["front", "rear"]
        for each in first.every:
            named = topics.depth_image if "depth" in image else topics.color_image
            assert each.own(named or "") == f"/{each.name}/{image}"
            assert points is None or each.own(points) == f"/{each.name}/points"
            assert each.own(frames.depth_camera) == each.own(frames.color_camera) == f"{each.name}_optical"


@pytest.mark.parametrize(
    ("others", "finding"),
    [
        ([kinect("rear", width=32)], "<sensor name='rear' type='depth'> of mast: a second depth camera is not taken"),
        ([kinect("rear", frame="eye")], "depth_camera rear: its frame is rear_camera_depth_optical_frame, not eye"),
        (
            [kinect("rear"), '<sensor name="up" type="depth_camera"/>'],
            "<sensor name='up' type='depth_camera'> of mast: another depth camera is not taken",
        ),
    ],
    ids=["another size", "another frame", "another kind"],
)
def test_what_is_not_taken_of_several_cameras_is_named(others: list[str], finding: str, tmp_path: Path):
    draft = drafted(with_sensors(kinect("front"), *others), tmp_path)
    assert finding in draft.findings
    assert declared(draft, tmp_path).depth_camera is not None


def test_a_camera_of_gz_has_the_topics_that_it_bridges(tmp_path: Path):
    noise = "<noise><stddev>0.01</stddev></noise>"
    rgbd = f'<sensor name="eyes" type="rgbd_camera"><topic>eyes</topic><camera>{noise}</camera></sensor>'
    draft = drafted(with_sensors(rgbd), tmp_path)
    found = declared(draft, tmp_path)
    assert (found.topics.color_image, found.topics.color_info) == ("/eyes/image", "/eyes/camera_info")
    assert (found.topics.depth_image, found.topics.depth_info) == ("/eyes/depth_image", None)
    assert found.topics.depth_points == "/eyes/points"
    assert found.color_camera is not None
    assert found.color_camera.noise == 0.01
    assert any("<noise> is not taken" in each for each in draft.findings)


def test_an_imu_errs_and_reads_as_often_as_it_says(tmp_path: Path):
    imu = (
        '<sensor name="imu" type="imu"><update_rate>10</update_rate><imu><angular_velocity><x><noise>'
        "<stddev>0.002</stddev></noise></x></angular_velocity><linear_acceleration><x><noise><stddev>0.02</stddev></noise></x>"
        '</linear_acceleration></imu><plugin name="i" filename="libgazebo_ros_imu_sensor.so"><ros>'
        "<remapping>~/out:=imu/data</remapping></ros></plugin></sensor>"
    )
    found = declared(drafted(with_sensors(imu), tmp_path), tmp_path)
    assert found.topics.imu == "/imu/data"
    expected = RosImu(x_m=0.1, z_m=0.5, gyro_sigma_rad_s=0.002, force_sigma_m_s2=0.02, rate_hz=10.0, heading=True)
    assert found.imu == expected


def test_a_second_camera_and_sensors_that_are_declared_by_hand_are_named(tmp_path: Path):
    sonar = '<sensor name="sonar" type="ray"><plugin name="s" filename="libgazebo_ros_range.so"/></sensor>'
    eyes = (f'<sensor name="{name}" type="camera"/>' for name in ("left", "right"))
    draft = drafted(with_sensors(*eyes, sonar, '<sensor name="north" type="magnetometer"/>'), tmp_path)
    assert declared(draft, tmp_path).lidar is None
    assert draft.findings == (
        "<sensor name='right' type='camera'> of mast: a second color camera is not taken",
        "<sensor name='sonar' type='ray'> of mast is not taken: ros.yaml declares range_finders",
        "<sensor name='north' type='magnetometer'> of mast is not taken: ros.yaml declares compass",
    )


def test_plugins_of_ros_2_have_other_tags_for_the_same(tmp_path: Path):
    plugin = (
        '<plugin name="d" filename="libgazebo_ros_diff_drive.so"><ros><namespace>/bot</namespace>'
        "<remapping>cmd_vel:=go</remapping></ros><wheel_separation>0.3</wheel_separation>"
        "<wheel_diameter>0.1</wheel_diameter><max_wheel_torque>1</max_wheel_torque>"
        "<robot_base_frame>base</robot_base_frame></plugin>"
    )
    draft = drafted(simple(plugin), tmp_path)
    found = declared(draft, tmp_path)
    assert (found.topics.command, found.topics.odometry) == ("/bot/go", "/odom")
    assert found.drive == DifferentialDrive(track_m=0.3)
    model = mujoco.MjModel.from_xml_string(draft.robot_xml)
    assert model.actuator("left").forcerange == pytest.approx([-20.0, 20.0])


def test_an_sdf_model_is_a_robot_too(tmp_path: Path):
    found = drafted(
        '<sdf version="1.6"><model name="cart"><link name="base"><inertial><mass>3</mass></inertial>'
        "<collision name='c'><pose>0 0 0.1 0 0 0</pose><geometry><cylinder><radius>0.2</radius><length>0.2</length>"
        "</cylinder></geometry></collision><sensor name='l' type='ray'><pose>0.1 0 0.15 0 0 0</pose><ray><scan>"
        "<horizontal><samples>181</samples><min_angle>-1.57</min_angle><max_angle>1.57</max_angle></horizontal></scan>"
        "<range><max>5</max></range></ray></sensor></link>"
        "<plugin name='d' filename='libgazebo_ros_skid_steer_drive.so'><wheelSeparation>0.3</wheelSeparation>"
        "<wheelDiameter>0.1</wheelDiameter></plugin></model></sdf>",
        tmp_path,
    )
    lidar = declared(found, tmp_path).lidar
    assert lidar is not None
    assert (lidar.rays, lidar.range_m, lidar.height_m, lidar.x_m, lidar.fov_rad) == (181, 5.0, 0.15, 0.1, 3.14)
    assert mujoco.MjModel.from_xml_string(found.robot_xml).body_mass.sum() == pytest.approx(3.0)
    assert "does not slip when it turns" in found.findings[0]


def test_what_ros_yaml_may_not_say_is_left_out_and_named(tmp_path: Path):
    plugin = '<plugin name="m" filename="libgazebo_ros_planar_move.so"><commandTopic>/1 2</commandTopic></plugin>'
    draft = drafted(simple(plugin), tmp_path)
    assert declared(draft, tmp_path).topics.command == "/cmd_vel"
    assert draft.findings[0].startswith("topics.command '/1 2' is not taken: ")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "not a URDF or SDF"),
        ("<!DOCTYPE robot><robot/>", "no document type, and no entities"),
        ("<launch/>", "begins with <launch>, not with <robot>"),
        ('<robot name="r"/>', "has 0 links"),
        (simple('<plugin name="c" filename="libgazebo_ros_control.so"/>'), r"no plugin .* drives a base .*ros_control"),
        (simple('<plugin name="d" filename="libgazebo_ros_diff_drive.so"/>'), "are lengths above 0"),
        (simple("", '<box size="1 nan 1"/>'), "size is '1 nan 1', not 3 numbers"),
        (
            simple("", more='<joint name="j" type="fixed"><parent link="base"/><child link="base"/></joint>'),
            "the link base is below itself",
        ),
    ],
)
def test_what_is_no_robot_is_refused_in_words(tmp_path: Path, text: str, words: str):
    with pytest.raises(LaunchRefused, match=words):
        drafted(text, tmp_path)
