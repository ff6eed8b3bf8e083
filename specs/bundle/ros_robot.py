"""The file ``ros.yaml`` in a bundle: what Simyard must know of a ROS robot besides its nodes.

Nothing of it is needed for a differential base: each field has a default, and what a Twist does to the actuators
follows from ``robot.xml`` where it can.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from specs.base import Spec
from specs.bundle.sensors import BumperDeclaration, LidarDeclaration, OdometryDeclaration

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
Frame = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_/]*$", max_length=255)]


class RosTopics(Spec):
    """Names of the topics; None for one that the robot does not have.

    Attributes:
        command: What drives the robot: geometry_msgs/Twist.
        scan: The lidar: sensor_msgs/LaserScan.
        odometry: nav_msgs/Odometry.
        joints: Of a robot that is more than a planar base: sensor_msgs/JointState.
        imu: sensor_msgs/Imu.
        bumper: Which sectors touch: std_msgs/UInt8MultiArray, 1 for a sector that touches.
        goal: The goal to go to now: geometry_msgs/PoseStamped, latched, when it changes.
        floor_map: The map of the world: nav_msgs/OccupancyGrid, latched.
    """

    command: Topic = "/cmd_vel"
    scan: Topic | None = "/scan"
    odometry: Topic | None = "/odom"
    joints: Topic | None = "/joint_states"
    imu: Topic | None = "/imu"
    bumper: Topic | None = "/bumper"
    goal: Topic | None = "/move_base_simple/goal"
    floor_map: Topic | None = None

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
        floor_map: The map's; odometry counts from its origin.
    """

    odometry: Frame = "odom"
    base: Frame = "base_link"
    laser: Frame = "laser"
    imu: Frame = "imu_link"
    floor_map: Frame = "map"


class DifferentialDrive(Spec):
    """Two driven wheels; a Twist becomes a speed of each.

    Attributes:
        left, right: Names of the actuators in ``robot.xml``.
        track_m: From one wheel to the other.
        wheel_radius_m: If the actuators take turning speeds of wheels (rad/s); None if they take speeds over the floor.
    """

    kind: Literal["differential"] = "differential"
    left: str = "left"
    right: str = "right"
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


RosDrive = Annotated[DifferentialDrive | VelocityDrive, Field(discriminator="kind")]


class RosRobot(Spec):
    """A ROS robot's base, sensors, topics and frames.

    Attributes:
        lidar: None for a robot without.
        odometry: Errors of its wheels; None for none.
        bumper: None for a robot without.
        drive: How a Twist becomes controls; None if it follows from ``robot.xml``.
        command_timeout_s: Simulated time after which a base that gets no command stops; 0 if it goes on for ever.
        ready_s: Wall time that the nodes may take to be ready.
    """

    topics: RosTopics = RosTopics()
    frames: RosFrames = RosFrames()
    lidar: LidarDeclaration | None = LidarDeclaration()
    odometry: OdometryDeclaration | None = None
    bumper: BumperDeclaration | None = None
    drive: RosDrive | None = None
    command_timeout_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    ready_s: Annotated[float, Field(gt=0.0, le=600.0)] = 60.0
