"""ROS 2 applications in lock-step with their episodes: a DDS domain, a robot and processes for each lane.

Messages come and go in ROS 1's form, so that lanes of both are brought through a control step by the same code.
"""

import functools
import os
import socket
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from specs.errors import LaunchRefused
from tasks.ros.launch.gazebo_launch import started_nodes
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, NodePlan, episode_environment
from tasks.ros.lockstep.exchange import FloorMap, Sensed, TwistCommand
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import NAVIGATE, STATIC
from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep
from tasks.ros.lockstep.ros_lane import RosLane
from tasks.ros.message.navigation import Navigation
from tasks.ros.process.application_processes import ApplicationProcesses
from tasks.ros.process.nap_gate import NapGate
from tasks.ros.process.network import EpisodeNetwork
from tasks.ros.process.thread_watch import Rest, ThreadWatch, own_wait_s
from tasks.ros.ros2.datagrams import DropWatch, UdpSocket
from tasks.ros.ros2.dds_domain import CYCLONE, FAST, EpisodeDomain, episode_domains
from tasks.ros.ros2.discovery_watch import DiscoveryWatch
from tasks.ros.ros2.launch_file.launch_description import make_spaces, resolve_description
from tasks.ros.ros2.navigation_client import NavigationClient
from tasks.ros.ros2.robot_links import RobotLink, RobotLinks
from tasks.ros.ros2.ros2_installation import Ros2Installation, ros2_installation
from tasks.ros.ros2.ros2_node import Matches, RobotInterface, Ros2Node
from tasks.ros.ros2.steady_clock import build_steady_clock, with_steady_clock

_LENGTH_BYTES = 4
# Connections seldom change, and asking for all of them costs as much as a message.
_MATCHES_S = 0.02
_RELIABLE = "the robot hears who is reliable alone: publish it with ReliabilityPolicy.RELIABLE, ROS 2's default"


class DomainThreads(ThreadWatch):
    """The threads of this process that receive for one domain: a command that they hold has not come yet."""

    def __init__(self) -> None:
        super().__init__()
        self.own: frozenset[int] = frozenset()

    def refresh(self, pids: Iterable[int]) -> None:
        """Looks again which of them there are."""
        super().refresh(pids)
        for tid in [tid for tid in self._threads if tid not in self.own]:
            self._forget(tid)

    def follow(self, threads: frozenset[int]) -> None:
        """Watches these from now on."""
        if threads != self.own:
            self.own = threads
            self.refresh([os.getpid()])


class LinkConnection(NamedTuple):
    """All readers of a topic in one process."""

    robot: Ros2Node
    topic: str

    def send(self, frame: bytes) -> None:
        """Publishes a message, given in ROS 1's form with its length before it."""
        self.robot.send(self.topic, frame[_LENGTH_BYTES:])


class ActionConnection(NamedTuple):
    """The node that offers the action NavigateToPose."""

    navigation: NavigationClient

    def send(self, frame: bytes) -> None:
        """Sends a goal, given in ROS 1's form with its length before it."""
        self.navigation.send(frame[_LENGTH_BYTES:])


class TopicReaders(NamedTuple):
    """The nodes of a process that read a topic: DDS has no order among them."""

    node: str
    connection: LinkConnection | ActionConnection


class Commanders(NamedTuple):
    """The nodes that write commands; the socket is one on which nothing ever comes."""

    sock: socket.socket


class DdsGraph:
    """One episode's nodes as the robot sees them.

    Args:
        domain: The episode's.
        interface: What the robot publishes and takes.
        processes: How many processes with nodes of ROS 2 there will be, and their names.
        pids: Returns all processes of the episode by now.
    """

    def __init__(
        self,
        domain: EpisodeDomain,
        interface: RobotInterface,
        processes: tuple[int, frozenset[str]],
        pids: Callable[[], Collection[int]] = tuple,
    ) -> None:
        self._robot, self._pids = RobotLinks(domain, interface), pids
        self._discovery = DiscoveryWatch(own_wait_s) if domain.middleware == FAST else None
        self._watch = DomainThreads()
        self._interface, (self._expected, self._names) = interface, processes
        self._quiet, self._other = socket.socketpair()
        self._matched_s = 0.0
        self._connected: dict[str, Matches] = {}
        self._changes = self._served = 0
        self._closed = False

    @property
    def busy(self) -> bool:
        """Returns whether a message is under way: not acknowledged, or in the hands of this process's threads."""
        return not self._closed and (not self._robot.acknowledged() or self._watch.look() is not Rest.ASLEEP)

    @property
    def served(self) -> int:
        """Returns a number that grows with every call of a service; those that have come are answered first."""
        if not self._closed:
            self._served += self._robot.serve()
        return self._served

    @property
    def changes(self) -> int:
        """Returns a number that grows when nodes connect or go."""
        now_s = time.perf_counter()
        if not self._closed and now_s - self._matched_s > _MATCHES_S:
            self._robot.find()
            self._watch.follow(self._robot.threads)
            before, self._matched_s = self._connected, now_s
            self._connected = {link.name: link.matches for link in self._robot.links.values()}
            self._changes += before != self._connected
        return self._changes

    @property
    def failure(self) -> str:
        """Returns why the episode cannot go on; for topics DDS gives no reason."""
        return self.navigation.fault

    @property
    def outgoing(self) -> Mapping[str, list[TopicReaders]]:
        """Returns who is connected to the robot's topics: one process at a time, by its nodes' names."""
        links = list(enumerate(self._robot.links.values()))
        return {
            NAVIGATE: [TopicReaders(NAVIGATE, ActionConnection(each)) for each in self._navigators()],
            **self._readers(links),
        }

    def _navigators(self) -> list[NavigationClient]:
        """Returns who takes goals, one at most."""
        node = self._robot.navigator()
        return [] if node is None or node.navigation is None else [node.navigation]

    def _readers(self, links: Sequence[tuple[int, RobotLink]]) -> Mapping[str, list[TopicReaders]]:
        return {
            topic: [
                TopicReaders(f"{place:06}", LinkConnection(link.node, topic))
                for place, link in links
                if link.matches.readers.get(topic)
            ]
            for topic in self._interface.topics
        }

    @property
    def incoming(self) -> list[Commanders]:
        """Returns whose commands the robot is connected to."""
        return [Commanders(self._quiet)] if self._commanders else []

    @property
    def _commanders(self) -> int:
        return sum(link.matches.commanders for link in self._robot.links.values())

    @property
    def tags(self) -> dict[str, str]:
        """Returns what the application gave to ``/robomaker/job/add_tags``."""
        return self._robot.job.tags

    @property
    def navigation(self) -> Navigation:
        """Returns how goals go that are sent as actions."""
        return self._robot.job.navigation

    def heard(self) -> list[tuple[str, bytes]]:
        """Returns what nodes said on recorded topics since the last call, in ROS 1's form."""
        return [] if self._closed else self._robot.heard()

    def dropped(self, lost: Mapping[int, UdpSocket]) -> int:
        """Returns how many of some datagrams that sockets dropped were meant for this episode."""
        return 0 if self._closed else self._robot.dropped(lost)

    @property
    def guessed(self) -> bool:
        """Returns whether the episode began although its nodes may not know each other."""
        return self._discovery is not None and self._discovery.guessed

    def contended(self) -> bool:
        """Returns whether two processes told a third one something since the last call."""
        return not self._closed and self._robot.contended()

    @property
    def cancelled(self) -> bool:
        """Returns whether the application called ``/robomaker/job/cancel``."""
        return self._robot.job.cancelled

    def publish(self, topic: str, data: bytes) -> bool:
        """Publishes a message; returns whether anybody reads it."""
        self._robot.publish(topic, data)
        return bool(self.outgoing[topic])

    def keep(self, topic: str, data: bytes) -> None:
        """Keeps a latched message for who comes."""
        self._robot.keep(topic, data)

    def take(self) -> list[tuple[str, bytes]]:
        """Returns the commands that have come since the last call: of a process in the order that they came in."""
        return [] if self._closed else [(self._interface.command, each) for each in self._robot.take_commands()]

    def nodes(self) -> frozenset[str]:
        """Returns the nodes' names: nobody registers in ROS 2, and ``unconnected`` says how many are missing."""
        return self._names

    def publishers(self, topic: str) -> frozenset[str]:
        """Returns names of nodes in processes that publish commands."""
        links = self._robot.links.values() if topic == self._interface.command else ()
        return frozenset(name for link in links if link.matches.commanders for name in link.names)

    def linked(self) -> bool:
        """Returns that nobody need be asked: DDS connects by what comes to its sockets."""
        return True

    def give_links_up(self) -> None:
        """Does nothing, as nobody is waited for."""

    def forget(self, ended: AbstractSet[int]) -> None:
        """Takes nodes' processes that ended for gone: without a farewell DDS has them for 20 s of wall time more."""
        if not self._closed:
            self._robot.forget(ended)

    def unconnected(self) -> list[str]:
        """Returns what keeps the episode from its beginning, for a person."""
        found: list[str] = []
        links = list(self._robot.links.values())
        if len(links) < self._expected:
            found.append(f"{len(links)} of {self._expected} processes with nodes are in the DDS domain")
        found += [f"{link.name} {why}" for link in links if (why := self._robot.missing(link))]
        if not found and self._discovery and len(links) > 1:
            told = self._discovery.told(self._pids(), len(links), self._robot.news_s)
            found += [] if told else ["its processes look for each other"]
        if not found and (topic := self._robot.overhears()):
            found.append(f"the robot does not overhear {topic} yet")
        refused = [link.name for link in links if any(not each.reliable for each in self._robot.commanders(link))]
        if refused:
            command = self._interface.command
            found.append(f"{', '.join(refused)} publishes {command} best effort: {_RELIABLE}")
        if self._interface.navigates and not self._navigators():
            found.append(f"no node offers the action {NAVIGATE} (goals in ros.yaml)")
        return found

    def gaps(self) -> list[str]:
        """Returns what nodes say or wait for in vain, for a person, as long as they are there."""
        return [] if self._closed else self._robot.gaps()

    def close(self) -> None:
        """Takes the robot out of its domain; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self._watch.close()
        self._robot.close()
        self._quiet.close()
        self._other.close()


_FOLDERS = ("tmp", "log")
_ROS_ARGUMENTS = "--ros-args"


class Ros2Lockstep(Ros1Lockstep):
    """The applications of all lanes of a chunk; see ``Lockstep``. Arguments are those of ``Ros1Lockstep``."""

    _domains: tuple[EpisodeDomain, ...] = ()
    _graphs: Mapping[int, DdsGraph] = MappingProxyType({})
    _of_nodes: dict[Path, Mapping[str, str]]
    _drops: DropWatch | None = None
    # Why the steady clock of C++ nodes is the machine's; None before anybody has asked.
    _untimed: str | None = None

    @property
    def _first_command_s(self) -> float:
        """Returns 0: who advertises in an episode is found by DDS when the wall's clock has it, not in lock-step."""
        return 0.0

    def _installation(self, source: LaunchSource) -> Ros2Installation:
        """Returns the ROS 2 that an application runs with: its image's, or this machine's."""
        image = self._images.get(source)
        return ros2_installation(image.ros2_variables() if image else None)

    def _resolved(
        self, source: LaunchSource, environments: list[Mapping[str, str]]
    ) -> Sequence[LaunchPlan | LaunchRefused]:
        home, installation = self._launch.home, self._installation(source)
        if installation.fault:
            return [LaunchRefused(installation.fault) for _ in environments]
        middleware = installation.middleware or CYCLONE
        if not self._domains:
            self._domains, self._of_nodes = tuple(episode_domains(len(self._launch.environment), middleware)), {}
        if middleware != (chosen := self._domains[0].middleware):
            why = f"it runs with {middleware}, and the robot application with {chosen}: choose one for both"
            return [LaunchRefused(f"the simulation application's ROS 2: {why}") for _ in environments]
        if image := self._images.get(source):
            return [image.plan(simulation=source == self._launch.simulation) for _ in environments]
        own = str(len(self._of_nodes))
        try:
            if source.bundle not in self._of_nodes:
                spaces = make_spaces(source.bundle, installation, home / "packages" / own)
                self._of_nodes[source.bundle] = installation.environment(spaces)
        except LaunchRefused as exc:
            return [exc for _ in environments]
        found: dict[frozenset[tuple[str, str]], LaunchPlan | LaunchRefused] = {}
        keys = [frozenset(each.items()) for each in environments]
        for key in keys:
            if key not in found:
                try:
                    found[key] = resolve_description(source, dict(key), home / "parameters" / own)
                except LaunchRefused as exc:
                    found[key] = exc
        return [found[key] for key in keys]

    def _lane(self, number: int, plan: LaunchPlan) -> RosLane:
        home = self._launch.home / f"lane-{number}"
        for name in _FOLDERS:
            (home / name).mkdir(parents=True, exist_ok=True)
        topics = {topic.name: _ros2_kind(topic.kind) for topic in self._messages.topics}
        robot = self._base.robot.topics
        once = (STATIC, robot.goal, robot.floor_map, robot.initial_pose)
        latched = frozenset(topic for topic in once if topic is not None)
        started = started_nodes(plan)
        names = frozenset(each.name for each in started)
        processes = sum(runs_ros2(each) or not each.named for each in started)
        domain, installation = self._domains[number], self._installation(self._launch.source)
        cyclone = domain.middleware == CYCLONE
        interface = RobotInterface(
            topics,
            self._messages.commands.name,
            installation.distribution,
            services=cyclone,
            navigates=self._base.robot.goals == "navigate_to_pose",
            recorded={topic: _ros2_kind(kind) for topic, kind in self._base.robot.record.items()},
        )
        gate = NapGate(self._pump.loop) if self._has_rclcpp else None
        application = ApplicationProcesses(home, self._tracker, self._limits, gate)
        application.watch.limits = True
        graph = DdsGraph(domain, interface, (processes, names), application.found)
        self._graphs = {**self._graphs, number: graph}
        detector = IdleDetector(application, graph, self._patience.nap_s)
        network = EpisodeNetwork(socket.socket, ())
        lane = self._lanes[number] = RosLane(detector, network, self._pump, latched, graph.contended)
        for source, own in self._divided(plan._replace(nodes=started)):
            variables = self._launch.variables(number, simulation=source == self._launch.simulation)
            of_domain = domain.environment(home, self._installation(source).fast_dds)
            if image := self._images.get(source):
                self._enter(lane, image, own, self._timed(lane, {**variables, **of_domain}))
                continue
            of_nodes = self._of_nodes.get(source.bundle, {})
            environment = {**variables, **of_nodes, **of_domain, **episode_environment(home)}
            self._start(lane, own, self._timed(lane, environment))
        return lane

    @functools.cached_property
    def _has_rclcpp(self) -> bool:
        """Returns whether nodes may be C++: their steady clock is simulated time then, and their naps have an order."""
        sources = filter(None, (self._launch.source, self._launch.simulation))
        return any(self._installation(each).library("rclcpp") for each in sources)

    def _timed(self, lane: RosLane, variables: Mapping[str, str]) -> Mapping[str, str]:
        """Returns an application's variables with which the steady clock of its C++ nodes follows simulated time."""
        if not self._has_rclcpp:
            return variables
        if self._untimed is None:
            self._untimed = build_steady_clock(self._launch.home)
        return with_steady_clock(self._launch.home, lane.application.home, variables)

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        """Waits as with ROS 1; an episode whose nodes may not know each other is late once."""
        super().begin(sensed, floors)
        for lane in self._lanes.values():
            lane.failure = "; ".join(filter(None, (lane.failure, self._untimed))) if lane.failure else ""
        for number, graph in self._graphs.items():
            self._lanes[number].unordered += graph.guessed

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        """Returns each lane's command for the control step to come; datagrams that were dropped in it count as late."""
        commands = super().exchange(sensed)
        self._drops = self._drops or DropWatch()
        if lost := self._drops.look():
            for number, graph in self._graphs.items():
                self._lanes[number].unordered += graph.dropped(lost) if sensed[number] is not None else 0
        return commands

    def printed(self, lane: int) -> str:
        """Returns what a lane's nodes printed last, and what they said, waited for or were timed by in vain."""
        return "\n".join(filter(None, (super().printed(lane), self._untimed)))

    def heard(self, lane: int) -> list[tuple[str, bytes]]:
        """Returns what a lane's nodes said on recorded topics since the last call, in ROS 1's form."""
        return self._graphs[lane].heard() if lane in self._graphs else []

    def close(self) -> None:
        """Ends every process, closes every port, removes every file; nothing happens a second time."""
        super().close()
        for domain in self._domains:
            domain.close()


def runs_ros2(node: NodePlan) -> bool:
    """Returns whether a process of a launch file is a node of ROS 2."""
    return _ROS_ARGUMENTS in node.command


def _ros2_kind(kind: str) -> str:
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}"
