"""What a document is told of a ROS launch file that it names: faults of it, and what else a person is to know."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from specs.base import Fault
from specs.launched_file import IMAGE_FILE, is_ros2

if TYPE_CHECKING:
    from tasks.ros.launch.gazebo_launch import GazeboLaunch
    from tasks.ros.launch.launch_plan import LaunchSource
    from tasks.simulate.sandbox.launch_check import LaunchReport

_MOST_ENVIRONMENTS = 16


def topic_lines(reports: Sequence["LaunchReport"]) -> Iterator[str]:
    """Yields a line for each topic of some launch files that nobody publishes, or that has two types."""
    # Loaded only where ROS is.
    from tasks.ros.launch.node_topics import unlike, unpublished  # noqa: PLC0415

    wants = dict.fromkeys(each for report in reports for each in report.wants)
    gives = [topic for report in reports for topic in report.gives]
    unknown = list(dict.fromkeys(node for report in reports for node in report.unknown))
    declared_by = {topic: field for report in reports for topic, field in report.undeclared.items()}
    yield from unpublished([*wants], gives, unknown, declared_by)
    ends = ([each for report in reports for each in (report.reads, report.writes)[k]] for k in (0, 1))
    yield from dict.fromkeys(unlike(*ends))


def report_lines(source: "LaunchSource", report: "LaunchReport") -> Iterator[str]:
    """Yields what a person is to know of a launch file."""
    yield report.ros
    name = f"{source.package} {source.launch_file}".strip() or "the container image"
    if report.unread:
        yield f"{name}: not read: {report.unread}"
    elif report.nodes:
        yield f"{name} starts {', '.join(report.nodes)}"
    if report.gazebo:
        yield from _gazebo_lines(source, report.gazebo)
    yield from report.missing
    yield from report.absent
    yield from report.python2


def _gazebo_lines(source: "LaunchSource", gazebo: "GazeboLaunch") -> Iterator[str]:
    """Yields what becomes of what a launch file asks of Gazebo."""
    name = f"{source.package} {source.launch_file}"
    yield from (f"{name}: {each.node} is not started; in its place: {each.by}" for each in gazebo.replaced)
    if gazebo.world:
        yield f"{name}: its world is {gazebo.world.relative_to(source.bundle)}"
    if gazebo.spawn:
        start = f"[{gazebo.spawn.x_m:g}, {gazebo.spawn.y_m:g}, {gazebo.spawn.yaw_rad:g}]"
        yield f"{name}: {gazebo.entity or 'its robot'} starts at {start}"
    yield from (f"{name}: {each}" for each in gazebo.findings)


def ros_launch_faults(path: str, source: "LaunchSource", report: "LaunchReport") -> Iterator[Fault]:
    """Yields what is wrong with a launch file and its bundle's ``ros.yaml``; ``path`` is where the document has it."""
    for why in (*report.refusals, *report.lost):
        if (source.bundle / IMAGE_FILE).is_file():
            yield command_fault(path, source.launch_file, source.command or (), why)
            continue
        launch = "ros2 launch" if is_ros2(source.launch_file) else "roslaunch"
        allowed = f"a launch file that {launch} takes, and not this one: {why}"
        yield Fault(path=f"{path}.launchFile", value=repr(source.launch_file), allowed=allowed)
    if report.declaration:
        allowed = f"a package whose bundle declares its robot rightly, and not this one: {report.declaration}"
        yield Fault(path=f"{path}.packageName", value=repr(source.package), allowed=allowed)


def command_fault(path: str, launch_file: str, command: Sequence[str], why: str) -> Fault:
    """Returns the fault of what a launch configuration starts: its launch file, or its command."""
    name, value = ("launchFile", launch_file) if launch_file else ("command", shlex.join(command))
    return Fault(path=f"{path}.{name}", value=repr(value), allowed=why)


def environments(variables: Mapping[str, str], sweep: Mapping[str, tuple[str, ...]]) -> list[dict[str, str]]:
    """Returns environments of episodes to read a launch file with: each value of a sweep once, a few in all."""
    first = {**variables, **{name: values[0] for name, values in sweep.items() if values}}
    others = [{**first, name: value} for name, values in sweep.items() for value in values[1:]]
    return [first, *others][:_MOST_ENVIRONMENTS]
