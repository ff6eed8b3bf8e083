"""The ROS launch files of the bundles that a document brings along: what roslaunch says of them."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from specs.arn import reference_path
from specs.base import Fault
from specs.bundle.launched_file import bundle_files, ros_launch_file
from specs.pipeline.document import PipelineSpec
from specs.robomaker.bundle import LATEST

if TYPE_CHECKING:  # few documents have a ROS launch file
    from tasks.ros.launch.resolve import LaunchSource
    from tasks.simulate.process.launch_check import LaunchReport

_MOST_ENVIRONMENTS = 16


class OwnLaunch(NamedTuple):
    """A ROS launch file of a document's own bundle, where the document names it, and what roslaunch says of it."""

    path: str
    source: "LaunchSource"
    report: "LaunchReport"


def ros_faults(launches: Sequence[OwnLaunch]) -> list[Fault]:
    """Returns a fault for each launch file that roslaunch refuses, if ROS is here, and for each wrong ``ros.yaml``."""
    return [fault for each in launches for fault in launch_faults(each.path, each.source, each.report)]


def ros_notes(launches: Sequence[OwnLaunch]) -> list[str]:
    """Returns what is to be said of launch files that is no fault of the document."""
    return list(dict.fromkeys(line for each in launches for line in report_lines(each.source, each.report)))


def report_lines(source: "LaunchSource", report: "LaunchReport") -> Iterator[str]:
    """Yields what a person is to know of a launch file."""
    yield report.ros
    name = f"{source.package} {source.launch_file}"
    if report.unread:
        yield f"{name}: not read: {report.unread}"
    elif report.nodes:
        yield f"{name} starts {', '.join(report.nodes)}"
    yield from report.missing


def launch_faults(path: str, source: "LaunchSource", report: "LaunchReport") -> Iterator[Fault]:
    """Yields what is wrong with a launch file and its bundle's ``ros.yaml``; ``path`` is where the document has it."""
    for why in report.refusals:
        allowed = f"a launch file that roslaunch takes, and not this one: {why}"
        yield Fault(path=f"{path}.launchFile", value=repr(source.launch_file), allowed=allowed)
    if report.declaration:
        allowed = f"a package whose bundle declares its robot rightly, and not this one: {report.declaration}"
        yield Fault(path=f"{path}.packageName", value=repr(source.package), allowed=allowed)


def own_ros_launches(spec: PipelineSpec, base: Path) -> list[OwnLaunch]:
    """Returns the ROS launch files that a document simulates of its own bundles; each is read once."""
    own = {each.name: base / each.source for each in spec.applications if each.kind == "robot"}
    read: dict[LaunchSource, LaunchReport] = {}
    found: list[OwnLaunch] = []
    for path, source, variables in _sources(spec, own):
        if source not in read:
            from tasks.simulate.process.launch_check import check_launch_file  # noqa: PLC0415

            read[source] = check_launch_file(source, environments(variables, _sweep(spec)), own=True)
        found.append(OwnLaunch(path, source, read[source]))
    return found


def environments(variables: Mapping[str, str], sweep: Mapping[str, tuple[str, ...]]) -> list[dict[str, str]]:
    """Returns environments of episodes to read a launch file with: each value of a sweep once, a few in all."""
    first = {**variables, **{name: values[0] for name, values in sweep.items() if values}}
    others = [{**first, name: value} for name, values in sweep.items() for value in values[1:]]
    return [first, *others][:_MOST_ENVIRONMENTS]


def _sources(spec: PipelineSpec, own: Mapping[str, Path]) -> Iterator["tuple[str, LaunchSource, dict[str, str]]"]:
    requests = spec.simulationBatch.createSimulationJobRequests if spec.simulationBatch else ()
    for number, request in enumerate(requests):
        for place, use in enumerate(request.robotApplications or ()):
            folder = own.get(reference_path(use.application)) if use.applicationVersion in {None, LATEST} else None
            package, name = use.launchConfig.packageName or "", use.launchConfig.launchFile or ""
            if folder is None or ros_launch_file(bundle_files(folder), package, name) is None:
                continue
            path = f"simulationBatch.createSimulationJobRequests[{number}].robotApplications[{place}].launchConfig"
            variables = use.launchConfig.environmentVariables or {}
            from tasks.ros.launch.resolve import LaunchSource  # noqa: PLC0415 - few documents have a ROS launch file

            yield path, LaunchSource(folder.resolve(), package, name), dict(variables)


def _sweep(spec: PipelineSpec) -> dict[str, tuple[str, ...]]:
    section = spec.simulationBatch
    return {name: tuple(values) for name, values in section.matrix.environmentVariables.items()} if section else {}
