"""``ros.yaml`` of a bundle: the base, the sensors, the topics and the frames of a robot that ROS drives; its draft."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from specs.base import Spec
from specs.bundle_files import (
    BumperDeclaration,
    ColorCameraDeclaration,
    CompassDeclaration,
    DepthCameraDeclaration,
    GpsDeclaration,
    ImuDeclaration,
    LidarDeclaration,
    OdometryDeclaration,
    RangeFindersDeclaration,
)

ROS_FILE = "ros.yaml"
Topic = Annotated[str, Field(pattern=r"^(/[A-Za-z][A-Za-z0-9_]*)+$", max_length=255)]
OWN_TOPICS = frozenset(
    [
        "/clock",
        "/tf",
        "/tf_static",
        "/rosout",
        "/map",
        "/ground_truth/odom",
        "/simyard/control",
        "/simyard/contact_impulse",
    ]
)
"""Topics of every robot and of every recording, which no robot has for something else."""
RECOVERIES, ERROR_CODE = "navigation_recoveries", "navigation_error_code"
NAVIGATION_METRICS = frozenset({RECOVERIES, ERROR_CODE})
"""What Nav2 says of its goals, as metrics of an episode."""
Frame = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_/]*$", max_length=255)]


# Nothing of it is needed for a differential base: each field has a default, and what a Twist does to the actuators
# follows from ``robot.xml`` where it can.
class RosTopics(Spec):
    """Names of the topics; None for one that the robot does not have.

    Attributes:
        command: What drives the robot: geometry_msgs/Twist.
        scan: The lidar: sensor_msgs/LaserScan.
        odometry: nav_msgs/Odometry.
        joints: Of a robot that is more than a planar base: sensor_msgs/JointState.
        imu: sensor_msgs/Imu.
        bumper: Which sectors touch: std_msgs/UInt8MultiArray, 1 for a sector that touches.
        depth_image, depth_info, depth_points: The depth camera: sensor_msgs/Image, CameraInfo, PointCloud2.
        color_image, color_info: The colour camera: sensor_msgs/Image, CameraInfo; with ``/compressed`` behind the name
            of the pictures, CompressedImage.
        range_finders: sensor_msgs/Range; several have a topic each, with ``_0``, ``_1`` and so on behind this name.
        compass: sensor_msgs/MagneticField, in the base's frame.
        gps: sensor_msgs/NavSatFix.
        goal: The goal to go to now: geometry_msgs/PoseStamped, latched, when it changes.
        floor_map: The map of the world: nav_msgs/OccupancyGrid, latched.
        localized: Where it is on the map: geometry_msgs/PoseWithCovarianceStamped.
        initial_pose: Where it is on the map when the episode begins, for a localizer: of the same type, latched.
    """

    command: Topic = "/cmd_vel"
    scan: Topic | None = "/scan"
    odometry: Topic | None = "/odom"
    joints: Topic | None = "/joint_states"
    imu: Topic | None = "/imu"
    bumper: Topic | None = "/bumper"
    depth_image: Topic | None = "/camera/depth/image_raw"
    depth_info: Topic | None = "/camera/depth/camera_info"
    depth_points: Topic | None = "/camera/depth/points"
    color_image: Topic | None = "/camera/color/image_raw"
    color_info: Topic | None = "/camera/color/camera_info"
    range_finders: Topic | None = "/range"
    compass: Topic | None = "/imu/mag"
    gps: Topic | None = "/fix"
    goal: Topic | None = "/move_base_simple/goal"
    floor_map: Topic | None = None
    localized: Topic | None = None
    initial_pose: Topic | None = None

    @model_validator(mode="after")
    def _one_meaning_each(self) -> Self:
        named = [(field, topic) for field, topic in self.model_dump().items() if topic is not None]
        seen: dict[str, str] = {}
        for field, topic in named:
            if topic in OWN_TOPICS and (field, topic) != ("floor_map", "/map"):
                raise ValueError(f"{field}: {topic} is a topic of every robot or recording: choose another name")
            if topic in seen:
                raise ValueError(f"{seen[topic]} and {field} are both {topic}: a topic has messages of one type")
            seen[topic] = field
        return self


class RosFrames(Spec):
    """Names of the frames in ``/tf`` and in messages' headers.

    Attributes:
        odometry: Where odometry counts from.
        base: The robot's base.
        laser: The lidar, fixed to the base by ``/tf_static``.
        imu: The inertial sensor, fixed to the base likewise.
        depth_camera, color_camera: The optical frames of cameras: z ahead, x to the right, y down (REP 103).
        range_finders: Which look along x; several have ``_0``, ``_1`` and so on behind this name.
        gps: The antenna of the receiver of satellites.
        floor_map: The map's; odometry counts from its origin.
    """

    odometry: Frame = "odom"
    base: Frame = "base_link"
    laser: Frame = "laser"
    imu: Frame = "imu_link"
    depth_camera: Frame = "camera_depth_optical_frame"
    color_camera: Frame = "camera_color_optical_frame"
    range_finders: Frame = "range"
    gps: Frame = "gps"
    floor_map: Frame = "map"


class DifferentialDrive(Spec):
    """Driven wheels on either side; a Twist becomes a speed of each.

    Attributes:
        left, right: Names of the actuators in ``robot.xml``; a list where a side has several wheels.
        track_m: From one side to the other. Wheels that slip when the robot turns stand for a wider track.
        wheel_radius_m: If the actuators take turning speeds of wheels (rad/s); None if they take speeds over the floor.
    """

    kind: Literal["differential"] = "differential"
    left: str | Annotated[tuple[str, ...], Field(min_length=1)] = "left"
    right: str | Annotated[tuple[str, ...], Field(min_length=1)] = "right"
    track_m: Annotated[float, Field(gt=0.0, le=100.0)]
    wheel_radius_m: Annotated[float, Field(gt=0.0, le=10.0)] | None = None


class VelocityDrive(Spec):
    """Actuators that take the parts of a Twist themselves.

    Attributes:
        forward: Actuator of the speed ahead (m/s).
        sideways: Of the speed to the left; None for a robot that cannot.
        turn: Of the turn rate (rad/s, counter-clockwise).
    """

    kind: Literal["velocity"] = "velocity"
    forward: str = "forward"
    sideways: str | None = None
    turn: str = "turn"


MessageType = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*/[A-Z][A-Za-z0-9]*$", max_length=255)]

RosDrive = Annotated[DifferentialDrive | VelocityDrive, Field(discriminator="kind")]


class RosDepthCamera(DepthCameraDeclaration):
    """A depth camera of a ROS robot.

    Attributes:
        encoding: Of its pictures: metres, +inf where nothing is seen, or millimetres, 0 there (REP 118).
    """

    encoding: Literal["32FC1", "16UC1"] = "32FC1"


class RosImu(ImuDeclaration):
    """An inertial measurement unit of a ROS robot.

    Attributes:
        heading: Whether it tells where it faces, too, as odometry has it; else its messages say that it does not know.
    """

    heading: bool = False


class RosRangeFinders(RangeFindersDeclaration):
    """Range finders of a ROS robot.

    Attributes:
        radiation: What they send out.
    """

    radiation: Literal["ultrasound", "infrared"] = "ultrasound"


def numbered(name: str, count: int) -> tuple[str, ...]:
    """Returns a name for each of some things: the only one has the name itself, several a number behind it."""
    return (name,) if count == 1 else tuple(f"{name}_{number}" for number in range(count))


class RosRobot(Spec):
    """A ROS robot's base, sensors, topics and frames.

    Attributes:
        lidar: None for a robot without.
        odometry: Errors of its wheels; None for none.
        bumper, depth_camera, color_camera, range_finders, compass, gps: None for a robot without.
        imu: Where it is and how it errs; None for one on the base that tells what is true.
        drive: How a Twist becomes controls; None for a planar base, where it follows from ``robot.xml``.
        command_timeout_s: Simulated time after which a base that gets no command stops; 0 if it goes on for ever.
        ready_s: Wall time that the nodes may take to be ready.
        first_command_s: Simulated time until which the robot may stand because no node publishes commands yet.
        time_over: What an episode is whose time is over, if its simulation application is to judge and says nothing.
        goals: How nodes are given them: on the topic, or as actions of Nav2's NavigateToPose or ROS 1's move_base.
        localization: Who says where ``odom`` is in the map's frame: the robot, or a node of the application.
        record: Topics of the nodes that a recording keeps, and their types, such as ``nav_msgs/OccupancyGrid``.
    """

    topics: RosTopics = RosTopics()
    frames: RosFrames = RosFrames()
    lidar: LidarDeclaration | None = LidarDeclaration()
    odometry: OdometryDeclaration | None = None
    bumper: BumperDeclaration | None = None
    depth_camera: RosDepthCamera | None = None
    color_camera: ColorCameraDeclaration | None = None
    imu: RosImu | None = None
    range_finders: RosRangeFinders | None = None
    compass: CompassDeclaration | None = None
    gps: GpsDeclaration | None = None
    drive: RosDrive | None = None
    command_timeout_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    ready_s: Annotated[float, Field(gt=0.0, le=600.0)] = 60.0
    first_command_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 10.0
    time_over: Literal["passed", "failed"] = "failed"
    goals: Literal["topic", "navigate_to_pose", "move_base"] = "topic"
    localization: Literal["given", "application"] = "given"
    record: Annotated[Mapping[Topic, MessageType], Field(max_length=32)] = {}

    @property
    def range_topics(self) -> tuple[str, ...]:
        """Returns a topic for each range finder that one tells of."""
        name, declared = self.topics.range_finders, self.range_finders
        return numbered(name, declared.finders) if name and declared else ()

    @property
    def compressed_topic(self) -> str | None:
        """Returns the topic of pictures in colour as JPEG, which ROS's image transport makes of the others."""
        raw = self.topics.color_image
        return f"{raw}/compressed" if raw and self.color_camera else None

    @property
    def _named_topics(self) -> Iterator[str]:
        """Yields the topics of cameras that have names: each topic's own, with the camera's before it."""
        depths = (self.topics.depth_image, self.topics.depth_info, self.topics.depth_points)
        colors = (self.topics.color_image, self.topics.color_info, self.compressed_topic)
        for camera, topics in ((self.depth_camera, depths), (self.color_camera, colors)):
            for each in camera.every if camera else ():
                yield from (each.own(topic) for topic in topics if topic and each.name)

    @model_validator(mode="after")
    def _records_topics_of_nodes(self) -> Self:
        named = {topic for field, topic in self.topics if topic is not None and field != "range_finders"}
        derived = {*self.range_topics, *filter(None, [self.compressed_topic]), *self._named_topics}
        for topic in sorted(derived & (named | OWN_TOPICS)):
            raise ValueError(f"topics: {topic} is made of one of its names, and is another's: choose another name")
        own = OWN_TOPICS - {"/map"} | named | derived
        for topic in self.record:
            if topic in own:
                raise ValueError(f"record: {topic} is a topic of the robot, which each recording has: leave it out")
        return self


class DraftRequest(Spec):
    """What is asked of the process that makes drafts.

    Attributes:
        bundle: Folder that holds the ROS packages.
        description: The robot's URDF or SDF.
        model_folders: Where ``model://`` leads.
    """

    bundle: Path
    description: str
    model_folders: tuple[Path, ...] = ()


class RobotDraft(Spec):
    """A draft of the files that declare a robot.

    Attributes:
        robot_xml: Of ``robot.xml``.
        ros_yaml: Of ``ros.yaml``.
        findings: What was not taken, and why, a sentence each.
        refused: Why there is no draft; or empty.
    """

    robot_xml: str = ""
    ros_yaml: str = ""
    findings: tuple[str, ...] = ()
    refused: str = ""
