"""What a robot's node publishes: its topics in the order of a control step, and their messages."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from tasks.ros.graph.publication import Topic
from tasks.ros.lockstep.exchange import Base, FloorPlan, Joints, Sensed
from tasks.ros.message import motion_message, sensor_message
from tasks.ros.message.stamp import Stamp, stamp

CLOCK, TRANSFORMS, STATIC = "/clock", "/tf", "/tf_static"
_NO_JOINTS = Joints((), np.zeros(0), np.zeros(0))


class Moment(NamedTuple):
    """What a lane's robot senses at a control step.

    Attributes:
        sequence: Number of the step.
        time_ns: Simulated time.
        sensed: By the robot.
    """

    sequence: int
    time_ns: int
    sensed: Sensed

    @property
    def time(self) -> Stamp:
        """Returns the simulated time as messages have it."""
        return stamp(self.time_ns)


class SensorMessages:
    """Writes the messages of one kind of robot.

    Args:
        base: The robot's base.
        control_s: Simulated time of a control step.

    Attributes:
        topics: All that the robot publishes.
        order: Those of each control step, in the order in which nodes get them: the clock, where the robot is, what it
            feels, and last what it sees, which most nodes answer.
        commands: The topic that drives it.
    """

    def __init__(self, base: Base, control_s: float) -> None:
        self._base, self._control_s = base, control_s
        names = base.robot.topics
        self._writers: dict[str, Callable[[Moment], bytes]] = {
            CLOCK: lambda moment: motion_message.clock(moment.time),
            TRANSFORMS: self._transforms,
        }
        self.commands = Topic(names.command, "geometry_msgs/Twist")
        self._goal, self._floor = names.goal, names.floor_map
        kinds: list[tuple[str | None, str, Callable[[Moment], bytes]]] = [
            (names.odometry, "nav_msgs/Odometry", self._odometry),
            (names.joints, "sensor_msgs/JointState", self._joints),
            (names.imu, "sensor_msgs/Imu", self._imu),
            (names.bumper if base.robot.bumper else None, "std_msgs/UInt8MultiArray", self._bumper),
            (names.scan if base.rays else None, "sensor_msgs/LaserScan", self._scan),
        ]
        own = [(name, kind, writer) for name, kind, writer in kinds if name is not None]
        self._writers.update((name, writer) for name, _, writer in own)
        self.order = tuple(self._writers)
        steady = [Topic(CLOCK, "rosgraph_msgs/Clock", latched=True), Topic(TRANSFORMS, "tf2_msgs/TFMessage")]
        latched = [(STATIC, "tf2_msgs/TFMessage"), (names.goal, "geometry_msgs/PoseStamped")]
        latched.append((names.floor_map, "nav_msgs/OccupancyGrid"))
        once = [Topic(name, kind, latched=True) for name, kind in latched if name is not None]
        self.topics = (*steady, *(Topic(name, kind) for name, kind, _ in own), *once)

    def write(self, topic: str, moment: Moment) -> bytes:
        """Returns a message of one of ``order``."""
        return self._writers[topic](moment)

    def fixed(self, moment: Moment, floor: FloorPlan | None) -> Mapping[str, bytes]:
        """Returns the messages that hold from the start: where sensors are mounted, the map."""
        found = {STATIC: self._static(moment)}
        if self._floor is not None and floor is not None:
            frame = self._base.robot.frames.floor_map
            found[self._floor] = motion_message.occupancy_grid(
                0, moment.time, frame, floor.cells, origin_m=floor.origin_m, cell_m=floor.cell_m
            )
        return found

    def goal(self, moment: Moment) -> tuple[str, bytes] | None:
        """Returns topic and message of the goal to go to; None for a robot without."""
        if self._goal is None:
            return None
        x, y = map(float, moment.sensed.goal)
        frame = self._base.robot.frames.odometry
        return self._goal, motion_message.pose_stamped(moment.sequence, moment.time, frame, (x, y, 0.0))

    def _static(self, moment: Moment) -> bytes:
        frames, lidar = self._base.robot.frames, self._base.robot.lidar
        each = [motion_message.FrameTransform(frames.base, frames.imu, (0.0, 0.0, 0.0))]
        if lidar is not None:
            where = (lidar.x_m, lidar.y_m, lidar.yaw_rad)
            each.append(motion_message.FrameTransform(frames.base, frames.laser, where))
        if self._floor is not None:
            each.append(motion_message.FrameTransform(frames.floor_map, frames.odometry, (0.0, 0.0, 0.0)))
        return motion_message.transforms(0, moment.time, each)

    def _transforms(self, moment: Moment) -> bytes:
        frames, pose = self._base.robot.frames, moment.sensed.pose
        where = (float(pose[0]), float(pose[1]), float(pose[2]))
        each = [motion_message.FrameTransform(frames.odometry, frames.base, where)]
        return motion_message.transforms(moment.sequence, moment.time, each)

    def _odometry(self, moment: Moment) -> bytes:
        frames, sensed = self._base.robot.frames, moment.sensed
        return motion_message.odometry(
            moment.sequence, moment.time, sensed.pose, sensed.velocity, frame=frames.odometry, child=frames.base
        )

    def _joints(self, moment: Moment) -> bytes:
        joints = moment.sensed.joints or _NO_JOINTS
        return sensor_message.joint_state(moment.sequence, moment.time, joints.names, joints.position, joints.speed)

    def _imu(self, moment: Moment) -> bytes:
        sensed = moment.sensed
        return sensor_message.imu(
            moment.sequence,
            moment.time,
            self._base.robot.frames.imu,
            yaw_rad=float(sensed.pose[2]),
            turn_rad_s=float(sensed.velocity[2]),
            acceleration=sensed.acceleration,
        )

    def _bumper(self, moment: Moment) -> bytes:
        return sensor_message.bumper(moment.sensed.bumper)

    def _scan(self, moment: Moment) -> bytes:
        base = self._base
        return sensor_message.laser_scan(
            moment.sequence,
            moment.time,
            base.robot.frames.laser,
            moment.sensed.ranges_m,
            angle_min=base.first_ray_rad,
            angle_increment=base.ray_step_rad,
            range_max=base.range_m,
            scan_s=self._control_s,
        )
