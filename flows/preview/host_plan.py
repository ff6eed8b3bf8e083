"""`simyard plan` for robots whose controllers run beside the program, as ROS nodes do."""

import math
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from flows.document.ros_launches import environments, launch_faults, report_lines
from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from tasks.ros.launch.resolve import LaunchSource
from tasks.simulate.forecast.node_cost import node_bytes, nodes_pace
from tasks.simulate.host.controller_kind import controller_kind
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.process.launch_check import LaunchReport, check_launch_file

_REQUESTS = "simulationBatch.createSimulationJobRequests[*].robotApplications[*].launchConfig"


class HostPlan(NamedTuple):
    """What is going to run beside the programs of a batch.

    Attributes:
        launches: What is known of each ROS launch file.
    """

    launches: Mapping[LaunchSource, LaunchReport]

    @property
    def simulated_clock(self) -> frozenset[str]:
        """Returns the launch files that make nodes wait for ``/clock``."""
        return frozenset(source.launch_file for source, each in self.launches.items() if each.simulated_clock)


def host_plan(batch: BatchPlan, folders: Mapping[str, Path], own: Collection[str]) -> HostPlan:
    """Returns what runs beside the programs of a batch.

    Args:
        batch: The batch.
        folders: Unpacked folders of its applications, by digest.
        own: Digests of the bundles that the document brings along.
    """
    launches: dict[LaunchSource, LaunchReport] = {}
    for template in batch.templates:
        robot = template.robot
        folder = folders[robot.digest]
        kind, source = controller_kind(folder, robot), _source(folder, robot)
        if kind in {"ros", "ros2"} and source not in launches:
            asked = environments(template.environment, batch.sweep)
            launches[source] = check_launch_file(source, asked, own=robot.digest in own)
    return HostPlan(launches)


def host_faults(plan: HostPlan) -> list[Fault]:
    """Returns a fault for each launch file that roslaunch refuses, and for each wrong ``ros.yaml``."""
    return [fault for source, report in plan.launches.items() for fault in launch_faults(_REQUESTS, source, report)]


def host_lines(plan: HostPlan, lanes: int) -> Iterator[str]:
    """Yields what a person is to know of it; ``lanes`` is how many episodes run side by side."""
    said: dict[str, None] = {}
    for source, report in plan.launches.items():
        if report.has_ros:  # else jobs will fail, which is said with the reason
            said.update(dict.fromkeys(report_lines(source, report)))
        if report.nodes:
            processes = lanes * len(report.nodes)
            gigabytes = math.ceil(processes * node_bytes() / 1e8) / 10
            pace = nodes_pace(lanes, len(report.nodes))
            started = f"{_count(lanes, 'lane')} at once: {_count(processes, 'process', 'processes')}"
            said[
                f"{started} of up to {gigabytes:.1f} GB together; about "
                f"{pace.low:,.0f} to {pace.high:,.0f} control steps a second in all"
            ] = None
    yield from said


def host_failures(plan: HostPlan) -> list[str]:
    """Returns why jobs will fail for what is not installed on this machine."""
    return list(dict.fromkeys(report.ros for report in plan.launches.values() if not report.has_ros))


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _source(folder: Path, robot: ApplicationLaunch) -> LaunchSource:
    return LaunchSource(folder, robot.package, robot.launch_file)
