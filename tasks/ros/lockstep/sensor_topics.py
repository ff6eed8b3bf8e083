"""The table of a ROS robot's sensors: what each one publishes, how often, and where it is mounted.

A sensor is a record at the end: the topics that tell of it, written from what the robot senses, and its frames on the
base. ``readings`` of what is sensed has the fields of the observation that the table names, as the step gives them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from specs.bundle_files import CameraDeclaration, PacedDeclaration
from specs.data.episode import control_stride
from specs.ros_robot import RosDepthCamera, RosRobot, numbered
from tasks.ros.lockstep.exchange import JointStates, RobotBase, Sensed
from tasks.ros.message import camera_messages, ros_messages
from tasks.ros.message.camera_messages import Pinhole
from tasks.ros.message.ros_messages import EarthPlace, Stamp, stamp

_IMAGE, _INFO, _POINTS = "sensor_msgs/Image", "sensor_msgs/CameraInfo", "sensor_msgs/PointCloud2"
_JPEG = "sensor_msgs/CompressedImage"
LARGE = frozenset([_IMAGE, _POINTS, _JPEG])
"""Types of messages that no recording keeps: of a camera a second would take megabytes."""
_NO_JOINTS = JointStates((), np.zeros(0), np.zeros(0))
_GRAVITY_M_S2 = 9.81
_RADIATION = {"ultrasound": ros_messages.ULTRASOUND, "infrared": ros_messages.INFRARED}


class Moment(NamedTuple):
    """What a lane's robot senses at a control step.

    Attributes:
        sequence: Number of the step, those in which nodes warm up among them.
        time_ns: Simulated time.
        sensed: By the robot.
        step: Number of the episode's step; below 0 while nodes warm up.
    """

    sequence: int
    time_ns: int
    sensed: Sensed
    step: int = 0

    @property
    def time(self) -> Stamp:
        """Returns the simulated time as messages have it."""
        return stamp(self.time_ns)


class SensorTopic(NamedTuple):
    """A topic that tells what a robot senses.

    Attributes:
        name: None if the robot does not have it.
        kind: Of its messages.
        write: Returns a message, of the moment at which it was true.
        stride: How many control steps lie between two.
        latency_steps: How many control steps old they are.
    """

    name: str | None
    kind: str
    write: Callable[[Moment], bytes]
    stride: int = 1
    latency_steps: int = 0

    def due(self, step: int) -> bool:
        """Returns whether there is a message in a control step; before the first reading has come there is none."""
        return (step - self.latency_steps) % self.stride == 0 and (step >= self.latency_steps or not self.latency_steps)


Mount = tuple[str, Sequence[float]]
"""A frame on the base, and where it is there, as ``FrameTransform`` has it."""


class RosSensor(NamedTuple):
    """A kind of sensor.

    Attributes:
        topics: Returns what tells of it, given the base and the simulated time of a control step.
        mounts: Returns its frames.
        readings: Fields of the observation that its messages are made of, beyond those of every robot.
    """

    topics: Callable[[RobotBase, float], Iterator[SensorTopic]]
    mounts: Callable[[RosRobot], Iterator[Mount]] = lambda _: iter(())
    readings: tuple[str, ...] = ()


def _pace(declared: PacedDeclaration | None, control_s: float) -> tuple[int, int]:
    """Returns how many control steps lie between two messages of a sensor, and how old they are."""
    return (control_stride(declared.rate_hz, control_s), declared.latency_steps) if declared else (1, 0)


def _joint_topics(base: RobotBase, _control_s: float) -> Iterator[SensorTopic]:
    def write(moment: Moment) -> bytes:
        joints = moment.sensed.joints or _NO_JOINTS
        return ros_messages.joint_state(moment.sequence, moment.time, joints.names, joints.position, joints.speed)

    yield SensorTopic(base.robot.topics.joints, "sensor_msgs/JointState", write)


def _imu_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    declared = base.robot.imu

    def felt(sensed: Sensed) -> ros_messages.Inertia:
        yaw_rad = float(sensed.pose[2])
        if declared is None:
            force = (*map(float, sensed.acceleration), _GRAVITY_M_S2)
            return ros_messages.Inertia((0.0, 0.0, float(sensed.velocity[2])), force, yaw_rad)
        return ros_messages.Inertia(
            sensed.readings["turn_rad_s"],
            sensed.readings["force_m_s2"],
            yaw_rad + declared.yaw_rad if declared.heading else None,
            declared.gyro_sigma_rad_s,
            declared.force_sigma_m_s2,
        )

    def write(moment: Moment) -> bytes:
        return ros_messages.imu(moment.sequence, moment.time, base.robot.frames.imu, felt(moment.sensed))

    yield SensorTopic(base.robot.topics.imu, "sensor_msgs/Imu", write, *_pace(declared, control_s))


def _imu_mounts(robot: RosRobot) -> Iterator[Mount]:
    imu = robot.imu
    yield robot.frames.imu, (imu.x_m, imu.y_m, imu.yaw_rad, imu.z_m) if imu else (0.0, 0.0, 0.0)


def _bumper_topics(base: RobotBase, _control_s: float) -> Iterator[SensorTopic]:
    if base.robot.bumper:
        kind = "std_msgs/UInt8MultiArray"
        yield SensorTopic(base.robot.topics.bumper, kind, lambda moment: ros_messages.bumper(moment.sensed.bumper))


def _range_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    finders = base.robot.range_finders
    if finders is None:
        return

    def written(number: int, frame: str) -> Callable[[Moment], bytes]:
        return lambda moment: ros_messages.range_reading(
            moment.sequence,
            moment.time,
            frame,
            float(moment.sensed.readings["finder_m"][number]),
            radiation=_RADIATION[finders.radiation],
            cone_rad=finders.cone_rad,
            range_max=finders.range_m,
        )

    pace, frames = _pace(finders, control_s), _range_frames(base.robot)
    for number, (topic, frame) in enumerate(zip(base.robot.range_topics, frames, strict=False)):
        yield SensorTopic(topic, "sensor_msgs/Range", written(number, frame), *pace)


def _range_frames(robot: RosRobot) -> tuple[str, ...]:
    return numbered(robot.frames.range_finders, robot.range_finders.finders) if robot.range_finders else ()


def _range_mounts(robot: RosRobot) -> Iterator[Mount]:
    finders = robot.range_finders
    if finders is None:
        return
    for number, frame in enumerate(_range_frames(robot)):
        yaw_rad = finders.first_rad + number * finders.apart_rad
        yield frame, (finders.out_m * math.cos(yaw_rad), finders.out_m * math.sin(yaw_rad), yaw_rad, finders.z_m)


def _scan_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    pace = _pace(base.robot.lidar, control_s)

    def write(moment: Moment) -> bytes:
        return ros_messages.laser_scan(
            moment.sequence,
            moment.time,
            base.robot.frames.laser,
            moment.sensed.ranges_m,
            angle_min=base.first_ray_rad,
            angle_increment=base.ray_step_rad,
            range_max=base.range_m,
            scan_s=pace[0] * control_s,
        )

    if base.rays:
        yield SensorTopic(base.robot.topics.scan, "sensor_msgs/LaserScan", write, *pace)


def _scan_mounts(robot: RosRobot) -> Iterator[Mount]:
    if robot.lidar is not None:
        yield robot.frames.laser, (robot.lidar.x_m, robot.lidar.y_m, robot.lidar.yaw_rad)


def _compass_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    compass = base.robot.compass
    if compass is None:
        return

    def write(moment: Moment) -> bytes:
        field_ut = moment.sensed.readings["field_ut"]
        return ros_messages.magnetic_field(
            moment.sequence, moment.time, base.robot.frames.base, field_ut, compass.sigma_ut
        )

    yield SensorTopic(base.robot.topics.compass, "sensor_msgs/MagneticField", write, *_pace(compass, control_s))


def _gps_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    gps = base.robot.gps
    if gps is None:
        return
    origin = EarthPlace(gps.latitude_deg, gps.longitude_deg, gps.altitude_m)
    sigma_m = math.hypot(gps.sigma_m, gps.drift_m)

    def write(moment: Moment) -> bytes:
        place = ros_messages.place_beside(origin, moment.sensed.readings["gps_m"])
        return ros_messages.satellite_fix(moment.sequence, moment.time, base.robot.frames.gps, place, sigma_m)

    yield SensorTopic(base.robot.topics.gps, "sensor_msgs/NavSatFix", write, *_pace(gps, control_s))


def _gps_mounts(robot: RosRobot) -> Iterator[Mount]:
    if robot.gps is not None:
        yield robot.frames.gps, (robot.gps.x_m, robot.gps.y_m, 0.0, robot.gps.z_m)


Seeing = TypeVar("Seeing", bound=CameraDeclaration)
Read = Callable[[Moment, str], np.ndarray]


class _Camera(NamedTuple):
    """A camera: how it projects, its optical frame, when its pictures come, and what makes topics its own."""

    pinhole: Pinhole
    frame: str
    pace: tuple[int, int]
    named: Callable[[str], str]

    @classmethod
    def all(cls, first: Seeing, frame: str, control_s: float) -> Iterator[tuple["_Camera", Seeing, Read]]:
        """Yields the cameras of a list, as they are declared, and what takes each one's picture from a reading."""
        for place, camera in enumerate(first.every):
            pinhole = Pinhole(camera.columns, camera.rows, camera.fov_rad)
            own = cls(pinhole, camera.own(frame), _pace(camera, control_s), camera.own)
            yield own, camera, partial(_picture_of, place if first.others else None)

    def topic(self, name: str | None, kind: str, write: Callable[[Moment], bytes]) -> SensorTopic:
        """Returns one of its topics."""
        return SensorTopic(name and self.named(name), kind, write, *self.pace)

    def info(self, name: str | None) -> SensorTopic:
        """Returns the topic that says how it projects."""
        return self.topic(name, _INFO, lambda moment: camera_messages.camera_info(*self.head(moment), self.pinhole))

    def head(self, moment: Moment) -> tuple[int, Stamp, str]:
        """Returns what the header of a message says."""
        return moment.sequence, moment.time, self.frame


def _picture_of(place: int | None, moment: Moment, reading: str) -> np.ndarray:
    pictures = moment.sensed.readings[reading]
    return pictures if place is None else pictures[place]


def _camera_mounts(frame: str, first: CameraDeclaration | None) -> Iterator[Mount]:
    for camera in first.every if first else ():
        turn = camera_messages.optical_turn(camera.yaw_rad, camera.pitch_rad)
        yield camera.own(frame), (camera.x_m, camera.y_m, camera.z_m, *turn)


def _depth_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    robot, names = base.robot, base.robot.topics
    if robot.depth_camera is None:
        return
    for camera, declared, read in _Camera.all(robot.depth_camera, robot.frames.depth_camera, control_s):
        yield camera.info(names.depth_info)
        yield camera.topic(names.depth_points, _POINTS, partial(_points, camera, read, declared.range_m))
        yield camera.topic(names.depth_image, _IMAGE, partial(_depths, camera, read, declared))


def _depths(camera: _Camera, read: Read, declared: RosDepthCamera, moment: Moment) -> bytes:
    pixels = camera_messages.depths_in_mm if declared.encoding == "16UC1" else camera_messages.depths_in_m
    return camera_messages.image(*camera.head(moment), pixels(read(moment, "depth_m"), declared.range_m))


def _points(camera: _Camera, read: Read, range_m: float, moment: Moment) -> bytes:
    seen_m = camera_messages.depths_in_m(read(moment, "depth_m"), range_m)
    return camera_messages.point_cloud(*camera.head(moment), camera.pinhole, seen_m)


def _color_topics(base: RobotBase, control_s: float) -> Iterator[SensorTopic]:
    robot = base.robot
    if robot.color_camera is None:
        return
    for camera, _, read in _Camera.all(robot.color_camera, robot.frames.color_camera, control_s):
        yield camera.info(robot.topics.color_info)
        yield camera.topic(
            robot.compressed_topic, _JPEG, partial(_colors, camera, read, camera_messages.compressed_image)
        )
        yield camera.topic(robot.topics.color_image, _IMAGE, partial(_colors, camera, read, camera_messages.image))


def _colors(camera: _Camera, read: Read, packed: Callable[..., bytes], moment: Moment) -> bytes:
    return packed(*camera.head(moment), read(moment, "color"))


ROS_SENSORS: tuple[RosSensor, ...] = (
    RosSensor(_joint_topics),
    RosSensor(_imu_topics, _imu_mounts, ("turn_rad_s", "force_m_s2")),
    RosSensor(_compass_topics, readings=("field_ut",)),
    RosSensor(_gps_topics, _gps_mounts, ("gps_m",)),
    RosSensor(_bumper_topics),
    RosSensor(_range_topics, _range_mounts, ("finder_m",)),
    RosSensor(_scan_topics, _scan_mounts),
    RosSensor(_depth_topics, lambda robot: _camera_mounts(robot.frames.depth_camera, robot.depth_camera), ("depth_m",)),
    RosSensor(_color_topics, lambda robot: _camera_mounts(robot.frames.color_camera, robot.color_camera), ("color",)),
)
"""In the order in which nodes are told: what a robot feels, then what it sees, which most nodes answer."""
READINGS = tuple(field for sensor in ROS_SENSORS for field in sensor.readings)
"""Fields of the observation that ``Sensed.readings`` has, if the robot has them."""
