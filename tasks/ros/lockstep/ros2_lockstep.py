"""ROS 2 applications in lock-step with their episodes: a DDS domain, a robot and processes for each lane."""

import socket
from collections.abc import Mapping

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchPlan, NodePlan
from tasks.ros.launch.node_environment import episode_environment
from tasks.ros.launch.resolve import LaunchSource
from tasks.ros.lockstep.dds_graph import DdsGraph
from tasks.ros.lockstep.quiet import QuietJudge
from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep
from tasks.ros.lockstep.ros_lane import RosLane
from tasks.ros.lockstep.sensor_message import STATIC
from tasks.ros.process.application import Application
from tasks.ros.process.network import Network
from tasks.ros.ros2.domain import EpisodeDomain, episode_domains
from tasks.ros.ros2.launch_file.resolve_description import resolve_description
from tasks.ros.ros2.launch_file.ros2_installation import ros2_installation

_FOLDERS = ("tmp", "log")
_ROS_ARGUMENTS = "--ros-args"


class Ros2Lockstep(Ros1Lockstep):
    """The applications of all lanes of a chunk; see ``Lockstep``. Arguments are those of ``Ros1Lockstep``."""

    _domains: tuple[EpisodeDomain, ...] = ()

    def _plans(self, environments: list[Mapping[str, str]]) -> list[LaunchPlan | LaunchRefused]:
        launch = self._launch
        source = LaunchSource(launch.bundle, launch.package, launch.launch_file)
        self._domains = tuple(episode_domains(len(launch.environment)))
        found: dict[frozenset[tuple[str, str]], LaunchPlan | LaunchRefused] = {}
        keys = [frozenset(each.items()) for each in environments]
        for key in keys:
            if key not in found:
                try:
                    found[key] = resolve_description(source, dict(key), launch.home / "parameters")
                except LaunchRefused as exc:
                    found[key] = exc
        return [found[key] for key in keys]

    def _lane(self, number: int, plan: LaunchPlan) -> RosLane:
        home = self._launch.home / f"lane-{number}"
        for name in _FOLDERS:
            (home / name).mkdir(parents=True, exist_ok=True)
        topics = {topic.name: _ros2_kind(topic.kind) for topic in self._messages.topics}
        robot = self._base.robot.topics
        latched = frozenset(topic for topic in (STATIC, robot.goal, robot.floor_map) if topic is not None)
        names = frozenset(each.name for each in plan.nodes)
        processes = sum(map(runs_ros2, plan.nodes))
        domain, distribution = self._domains[number], ros2_installation().distribution
        graph = DdsGraph(domain, topics, self._messages.commands.name, distribution, (processes, names))
        application = Application(home, self._lineage, self._limits)
        judge = QuietJudge(application, graph, self._patience.nap_s)
        lane = self._lanes[number] = RosLane(judge, Network(socket.socket, ()), self._pump, latched)
        environment = {
            **self._launch.environment[number],
            **ros2_installation().environment(),
            **domain.environment,
            **episode_environment(home),
        }
        self._start(lane, plan, environment)
        return lane


def runs_ros2(node: NodePlan) -> bool:
    """Returns whether a process of a launch file is a node of ROS 2."""
    return _ROS_ARGUMENTS in node.command


def _ros2_kind(kind: str) -> str:
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}"
