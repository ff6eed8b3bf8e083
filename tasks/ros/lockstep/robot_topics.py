"""What a robot's node publishes: topics in the order of a control step, their messages, and a recorder for a bag.

The recorder stands before any other lock-step, of ROS 1 or ROS 2, and writes each message once more, since what is
written follows from what is sensed. What nodes tell each other goes past it.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from specs.bundle_files import (
    BumperDeclaration,
    ColorCameraDeclaration,
    CompassDeclaration,
    GpsDeclaration,
    LidarDeclaration,
)
from specs.data.episode import CONTROL_S
from specs.ros_robot import RosDepthCamera, RosRangeFinders, RosRobot
from tasks.ros.bag.message_log import FIRST_NS, Channel, LogEntry, MessageLog
from tasks.ros.graph.topic import Topic
from tasks.ros.lockstep.exchange import (
    ExchangeTotals,
    FloorMap,
    GoalEnd,
    Lockstep,
    RobotBase,
    Sensed,
    TwistCommand,
)
from tasks.ros.lockstep.sensor_topics import LARGE, ROS_SENSORS, Moment, SensorTopic
from tasks.ros.message import ros_messages
from tasks.ros.message.navigation import MOVE_BASE
from tasks.ros.message.ros_messages import PlanarTwist, twist

CLOCK, TRANSFORMS, STATIC = "/clock", "/tf", "/tf_static"
NAVIGATE = "/navigate_to_pose"
"""Stands among topics for the action of that name: a goal goes to the one node that offers it."""
ACTIONS: Mapping[str, str] = MappingProxyType({"navigate_to_pose": NAVIGATE, "move_base": MOVE_BASE})
_POSE = "geometry_msgs/PoseWithCovarianceStamped"


class SensorMessages:
    """Writes the messages of one kind of robot.

    Args:
        base: The robot's base.
        control_s: Simulated time of a control step.

    Attributes:
        topics: All that the robot publishes.
        order: Those of control steps, in the order in which nodes get them: the clock, where the robot is, what it
            feels, and last what it sees, which most nodes answer.
        commands: The topic that drives it.
    """

    def __init__(self, base: RobotBase, control_s: float) -> None:
        self._base, self._control_ns = base, round(control_s * 1e9)
        names = base.robot.topics
        self.commands = Topic(names.command, "geometry_msgs/Twist")
        self._floor, acts = names.floor_map, base.robot.goals != "topic"
        self._goal = ACTIONS.get(base.robot.goals, names.goal)
        frames, given = base.robot.frames, base.robot.localization == "given"
        # Without a map the pose counts from the world's origin, and nobody else says where that is.
        self._given = given and self._floor is not None
        self._goal_frame = frames.floor_map if (acts and self._floor is not None) or not given else frames.odometry
        self._initial_pose = names.initial_pose
        own = [
            SensorTopic(CLOCK, "rosgraph_msgs/Clock", lambda moment: ros_messages.clock(moment.time)),
            SensorTopic(TRANSFORMS, "tf2_msgs/TFMessage", self._transforms),
            SensorTopic(names.localized, _POSE, self._pose_on_map),
            SensorTopic(names.odometry, "nav_msgs/Odometry", self._odometry),
            *(each for sensor in ROS_SENSORS for each in sensor.topics(base, control_s)),
        ]
        self._own = {each.name: each for each in own if each.name is not None}
        self.order = tuple(self._own)
        latched = [(STATIC, "tf2_msgs/TFMessage"), (None if acts else names.goal, "geometry_msgs/PoseStamped")]
        latched += [(names.floor_map, "nav_msgs/OccupancyGrid"), (names.initial_pose, _POSE)]
        once = [Topic(name, kind, latched=True) for name, kind in latched if name is not None]
        self.topics = (*(Topic(name, each.kind, latched=name == CLOCK) for name, each in self._own.items()), *once)

    def due(self, moment: Moment) -> list[str]:
        """Returns those of ``order`` that have a message in a control step: each sensor has its rate."""
        return [name for name, each in self._own.items() if each.due(moment.step)]

    def write(self, topic: str, moment: Moment) -> bytes:
        """Returns a message of one of ``order``, with the time at which it was true."""
        own = self._own[topic]
        return own.write(moment._replace(time_ns=moment.time_ns - own.latency_steps * self._control_ns))

    def fixed(self, moment: Moment, floor: FloorMap | None) -> Mapping[str, bytes]:
        """Returns the messages that hold from the start: where sensors are mounted, the map."""
        robot = self._base.robot
        frames, mounts = robot.frames, dict(mount for sensor in ROS_SENSORS for mount in sensor.mounts(robot))
        each = [ros_messages.FrameTransform(frames.base, frame, pose) for frame, pose in mounts.items()]
        if self._given:
            each.append(ros_messages.FrameTransform(frames.floor_map, frames.odometry, (0.0, 0.0, 0.0)))
        found = {STATIC: ros_messages.transforms(0, moment.time, each)}
        if self._floor is not None and floor is not None:
            frame = self._base.robot.frames.floor_map
            found[self._floor] = ros_messages.occupancy_grid(
                0, moment.time, frame, floor.cells, origin_m=floor.origin_m, cell_m=floor.cell_m
            )
        if self._initial_pose is not None:
            found[self._initial_pose] = self._pose_on_map(moment)
        return found

    def goal(self, moment: Moment) -> tuple[str, bytes] | None:
        """Returns topic and message of the goal to go to; None for a robot without."""
        if self._goal is None:
            return None
        x, y = map(float, moment.sensed.goal)
        return self._goal, ros_messages.pose_stamped(moment.sequence, moment.time, self._goal_frame, (x, y, 0.0))

    def _pose_on_map(self, moment: Moment) -> bytes:
        frame = self._base.robot.frames.floor_map
        return ros_messages.pose_with_covariance(moment.sequence, moment.time, frame, moment.sensed.pose)

    def _transforms(self, moment: Moment) -> bytes:
        frames, pose = self._base.robot.frames, moment.sensed.pose
        where = (float(pose[0]), float(pose[1]), float(pose[2]))
        each = [ros_messages.FrameTransform(frames.odometry, frames.base, where)]
        return ros_messages.transforms(moment.sequence, moment.time, each)

    def _odometry(self, moment: Moment) -> bytes:
        frames, sensed = self._base.robot.frames, moment.sensed
        return ros_messages.odometry(
            moment.sequence, moment.time, sensed.pose, sensed.velocity, frame=frames.odometry, child=frames.base
        )


def published(robot: RosRobot) -> tuple[Topic, ...]:
    """Returns all topics of a robot, by what it declares."""
    return SensorMessages(RobotBase(robot, robot.lidar.rays if robot.lidar else 0, 0.0, 0.0, 0.0), CONTROL_S).topics


_OPTIONAL = MappingProxyType(
    {
        "lidar": LidarDeclaration(),
        "bumper": BumperDeclaration(),
        "depth_camera": RosDepthCamera(),
        "color_camera": ColorCameraDeclaration(),
        "range_finders": RosRangeFinders(),
        "compass": CompassDeclaration(),
        "gps": GpsDeclaration(),
    }
)


def undeclared(robot: RosRobot) -> Mapping[str, str]:
    """Returns topics that a robot lacks, and which field of ``ros.yaml`` declares the sensor that each tells of."""
    lacks = {name: sensor for name, sensor in _OPTIONAL.items() if getattr(robot, name) is None}
    has = {topic.name for topic in published(robot)}
    each = ((name, published(robot.model_copy(update={name: sensor}))) for name, sensor in lacks.items())
    return {topic.name: name for name, topics in each for topic in topics if topic.name not in has}


class LockstepRecorder:
    """The applications of all lanes, with a log of one lane, without its pictures; see ``Lockstep``.

    Args:
        lockstep: Has the applications.
        base: The robot's base.
        control_s: Simulated time of a control step.
        lane: Which is kept.
    """

    def __init__(self, lockstep: Lockstep, base: RobotBase, control_s: float, lane: int = 0) -> None:
        self._inner, self._lane, self._base = lockstep, lane, base
        self._messages = SensorMessages(base, control_s)
        self._kinds = {topic.name: topic.kind for topic in self._messages.topics}
        self._control_ns = round(control_s * 1e9)
        self._entries: list[LogEntry] = []
        self._goal: tuple[float, float] | None = None
        self._step = 0

    @property
    def failures(self) -> Mapping[int, str]:
        """Returns why applications failed, by lane."""
        return self._inner.failures

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose application called ``/robomaker/job/cancel``."""
        return self._inner.cancelled

    @property
    def tests(self) -> Mapping[int, bool]:
        """Returns the lanes whose test nodes have ended, and whether all of them passed."""
        return self._inner.tests

    @property
    def goal_ends(self) -> Mapping[int, GoalEnd]:
        """Returns the lanes in which a goal ended otherwise than it should, and how."""
        return self._inner.goal_ends

    def heard(self, lane: int) -> Sequence[tuple[str, bytes]]:
        """Returns what a lane's nodes said on recorded topics since the last call; of the kept lane nothing is left."""
        return self._inner.heard(lane)

    def simulation_failed(self, lane: int) -> bool:
        """Returns whether what failed in a lane was the simulation application."""
        return self._inner.simulation_failed(lane)

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        """Waits until every application is ready, and lets it warm up; of that nothing is kept."""
        self._inner.begin(sensed, floors)
        own = sensed[self._lane]
        if own is not None:
            fixed = self._messages.fixed(Moment(0, FIRST_NS, own), floors[self._lane])
            self._entries += [LogEntry(FIRST_NS, topic, data) for topic, data in fixed.items()]

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        """Returns each lane's command for the control step to come, having kept what one lane's robot said."""
        own, before = sensed[self._lane], self._inner.tally(self._lane).commands
        if own is not None:
            self._keep_sensed(Moment(self._step, FIRST_NS + self._step * self._control_ns, own, self._step))
        commands = self._inner.exchange(sensed)
        if own is not None and self._inner.tally(self._lane).commands > before:
            at_ns, command = FIRST_NS + self._step * self._control_ns, commands[self._lane]
            self._entries.append(LogEntry(at_ns, self._messages.commands.name, twist(PlanarTwist(*command))))
        at_ns = FIRST_NS + self._step * self._control_ns
        self._entries += [LogEntry(at_ns, topic, data) for topic, data in self._inner.heard(self._lane)]
        self._step += 1
        return commands

    @property
    def placed(self) -> Mapping[int, tuple[float, float, float]]:
        """Returns where nodes set robots in the last control step, by lane."""
        return self._inner.placed

    def tally(self, lane: int) -> ExchangeTotals:
        """Returns how the exchange of a lane went so far."""
        return self._inner.tally(lane)

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns what a lane's application gave to ``/robomaker/job/add_tags``."""
        return self._inner.tags(lane)

    def printed(self, lane: int) -> str:
        """Returns what a lane's nodes printed last."""
        return self._inner.printed(lane)

    def close(self) -> None:
        """Ends every process; the log stays."""
        self._inner.close()

    def log(self) -> MessageLog:
        """Returns what was kept, in times since the episode began; in a control step the last command."""
        recorded = (Topic(name, kind) for name, kind in self._base.robot.record.items())
        told = (each for each in self._messages.topics if each.kind not in LARGE)
        topics = (*told, self._messages.commands, *recorded)
        # The clock is latched for nodes that come late; in a bag it is a topic like others.
        channels = tuple(Channel(each.name, each.kind, latched=each.latched and each.name != CLOCK) for each in topics)
        return MessageLog(channels, tuple(self._entries))

    def _keep_sensed(self, moment: Moment) -> None:
        for topic in self._messages.due(moment):
            if self._kinds[topic] in LARGE:
                continue
            self._entries.append(LogEntry(moment.time_ns, topic, self._messages.write(topic, moment)))
        x_m, y_m = map(float, moment.sensed.goal)
        found = self._messages.goal(moment) if self._goal != (x_m, y_m) else None
        if found is not None and found[0] not in ACTIONS.values():
            self._goal = (x_m, y_m)
            self._entries.append(LogEntry(moment.time_ns, *found))
