"""What lock-step, the same for ROS 1 and ROS 2, hands over: to an episode at a control step, and to its graph."""

import socket
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float

from specs.ros_robot import RosRobot
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.message.navigation import Navigation


class Sends(Protocol):
    """A connection that takes messages with their length before them."""

    def send(self, data: bytes, /) -> None:
        """Sends bytes."""
        ...


class TopicListener(Protocol):
    """A node that listens to one of the robot's topics."""

    @property
    def node(self) -> str:
        """Returns its name."""
        ...

    @property
    def connection(self) -> Sends:
        """Returns what it listens on."""
        ...


class Commander(Protocol):
    """A node that commands the robot."""

    @property
    def sock(self) -> socket.socket:
        """Returns what wakes whoever waits for commands."""
        ...


class GraphSide(Protocol):
    """One episode's nodes and topics, as its robot sees them; ``tasks.ros.graph.graph.Graph`` says what each means."""

    @property
    def busy(self) -> int | bool: ...  # noqa: D102

    @property
    def served(self) -> int: ...  # noqa: D102

    @property
    def changes(self) -> int: ...  # noqa: D102

    @property
    def failure(self) -> str: ...  # noqa: D102

    @property
    def outgoing(self) -> Mapping[str, Sequence[TopicListener]]: ...  # noqa: D102

    @property
    def incoming(self) -> Sequence[Commander]: ...  # noqa: D102

    @property
    def navigation(self) -> Navigation: ...  # noqa: D102

    @property
    def tags(self) -> dict[str, str]: ...  # noqa: D102

    @property
    def cancelled(self) -> bool: ...  # noqa: D102

    def publish(self, topic: str, data: bytes) -> bool: ...  # noqa: D102

    def keep(self, topic: str, data: bytes) -> None: ...  # noqa: D102

    def take(self) -> list[tuple[str, bytes]]: ...  # noqa: D102

    def nodes(self) -> AbstractSet[str]: ...  # noqa: D102

    def publishers(self, topic: str) -> AbstractSet[str]: ...  # noqa: D102

    def unconnected(self) -> list[str]: ...  # noqa: D102

    def linked(self) -> bool: ...  # noqa: D102

    def give_links_up(self) -> None: ...  # noqa: D102

    def forget(self, ended: AbstractSet[int]) -> None: ...  # noqa: D102

    def gaps(self) -> list[str]: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class JointStates(NamedTuple):
    """Of a robot that is more than a planar base: what ``/joint_states`` says."""

    names: tuple[str, ...]
    position: Float[np.ndarray, "joints"]
    speed: Float[np.ndarray, "joints"]


class FloorMap(NamedTuple):
    """The map of a lane's world, as an occupancy grid has it: 0 free, 100 not free, rows from the origin along y."""

    cells: np.ndarray
    origin_m: tuple[float, float]
    cell_m: float


class Sensed(NamedTuple):
    """What a lane's robot senses before a control step.

    Attributes:
        pose: Where it believes to be: (x m, y m, yaw rad).
        velocity: In its own frame: (m/s ahead, m/s to the left, rad/s).
        acceleration: In its own frame: (m/s2 ahead, m/s2 to the left).
        ranges_m: The lidar's, counter-clockwise from ``Base.first_ray_rad``; its range where nothing is seen.
        bumper: Which sectors touched.
        goal: The goal to go to now, (x m, y m), in the frame that the pose is in.
        joints: None for a planar base.
        readings: Of sensors that not every robot has, by the names of the observation's fields.
    """

    pose: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]
    acceleration: Float[np.ndarray, "2"]
    ranges_m: Float[np.ndarray, "rays"]
    bumper: Bool[np.ndarray, "sectors"]
    goal: Float[np.ndarray, "2"]
    joints: JointStates | None = None
    readings: Mapping[str, np.ndarray] = MappingProxyType({})


class TwistCommand(NamedTuple):
    """The last Twist that came: in the robot's own frame."""

    ahead_m_s: float = 0.0
    left_m_s: float = 0.0
    turn_rad_s: float = 0.0


class RobotBase(NamedTuple):
    """A robot's base: what its nodes are told of it beyond ``ros.yaml``.

    Attributes:
        robot: The declaration, its defaults filled in.
        rays: How many rays the lidar has; 0 for none.
        first_ray_rad, ray_step_rad: Direction of the first ray in the lidar's frame, and from one to the next.
        range_m: The lidar's.
    """

    robot: RosRobot
    rays: int
    first_ray_rad: float
    ray_step_rad: float
    range_m: float


class Launch(NamedTuple):
    """What is launched for each lane.

    Attributes:
        bundle: Folder that holds the ROS packages.
        package: The launch configuration's packageName.
        launch_file: Its launchFile, with ``.launch`` or ``.launch.py``.
        home: An empty folder to write to, for logs and temporary files; gone after ``close``.
        environment: Of each lane: its environment variables.
        judging: Of each lane: those of the simulation application's nodes; empty where they are the same.
        simulation: What the simulation application launches, if it is ROS's; the same where there is no robot
            application.
        command: Of a container image: what is run in place of a launch file.
    """

    bundle: Path
    package: str
    launch_file: str
    home: Path
    environment: Sequence[Mapping[str, str]]
    simulation: LaunchSource | None = None
    command: tuple[str, ...] | None = None
    judging: Sequence[Mapping[str, str]] = ()

    def variables(self, lane: int, *, simulation: bool) -> Mapping[str, str]:
        """Returns the environment variables of one application's nodes in a lane."""
        return self.judging[lane] if simulation and self.judging else self.environment[lane]

    @property
    def source(self) -> LaunchSource:
        """Returns what drives."""
        return LaunchSource(self.bundle, self.package, self.launch_file, self.command)


class ExchangeTotals(NamedTuple):
    """How the exchange of one lane went; lock-step held if ``late`` and ``stray`` are 0.

    Attributes:
        commands: Twists that came.
        late: Stages in which the lane did not come to rest in time, or two processes told a third one something; and
            datagrams to its nodes or its robot that the kernel dropped.
        stray: Commands, and places to set the robot to, that came after the lane was taken for quiet.
        recoveries: How often navigation recovered, as its feedback says; None if that says nothing.
    """

    commands: int = 0
    late: int = 0
    stray: int = 0
    recoveries: int | None = None


class GoalEnd(NamedTuple):
    """How a goal that was sent as an action ended, if otherwise than it should.

    Attributes:
        reason: The outcome's.
        error_code: What the result says; 0 for nothing.
    """

    reason: Literal["aborted", "canceled"]
    error_code: int


class Lockstep(Protocol):
    """Applications of all lanes of a chunk, a graph and processes of its own for each lane."""

    @property
    def failures(self) -> Mapping[int, str]:
        """Returns why applications failed, by lane, for a person; such a lane is asked nothing more."""
        ...

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose application called ``/robomaker/job/cancel``."""
        ...

    @property
    def tests(self) -> Mapping[int, bool]:
        """Returns the lanes whose test nodes have ended, and whether all of them passed."""
        ...

    @property
    def goal_ends(self) -> Mapping[int, GoalEnd]:
        """Returns the lanes in which a goal ended otherwise than it should, and how."""
        ...

    def heard(self, lane: int) -> Sequence[tuple[str, bytes]]:
        """Returns what a lane's nodes said on recorded topics since the last call, in ROS 1's form."""
        ...

    def simulation_failed(self, lane: int) -> bool:
        """Returns whether what failed in a lane was the simulation application."""
        ...

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        """Waits until every application is ready, and lets it warm up with its robot at rest.

        Args:
            sensed: What each lane's robot senses at its start; None for a lane that is not driven.
            floors: The maps, if ``topics.floor_map`` is declared.
        """
        ...

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        """Returns each lane's command for the control step to come; None marks lanes that are done."""
        ...

    @property
    def placed(self) -> Mapping[int, tuple[float, float, float]]:
        """Returns where nodes set robots in the last control step, (x m, y m, yaw rad), by lane."""
        ...

    def tally(self, lane: int) -> ExchangeTotals:
        """Returns how the exchange of a lane went so far."""
        ...

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns what a lane's application gave to ``/robomaker/job/add_tags``."""
        ...

    def printed(self, lane: int) -> str:
        """Returns what a lane's nodes printed last, and what they said or waited for in vain; empty for nothing."""
        ...

    def close(self) -> None:
        """Ends every process, closes every port, removes every file; nothing happens a second time."""
        ...
