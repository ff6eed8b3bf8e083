"""What a document launches, held against the bundles that it brings along; the rest is known to a store alone."""

from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from specs.arn import reference_path
from specs.base import Fault
from specs.bundle.launched_file import (
    bundle_files,
    looked_for,
    module_file,
    names_ros_launch,
    ros_launch_file,
    simulated_file,
)
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.driven_requests import undriven_faults
from specs.robomaker.bundle import LATEST, ApplicationKind
from tasks.applications.registry import shipped_application

ROBOT_XML = "robot.xml"
_EXAMPLE = "examples/ros/turtlebot3/robot.xml"


class _Launch(NamedTuple):
    """What is launched, and of which application, as the document names it; empty if it does not say."""

    path: str
    kind: str
    application: str
    version: str | None
    package: str
    file: str
    simulated: bool

    def fault(self, files: Collection[str]) -> Fault | None:
        """Returns what is wrong with it, given the files of its bundle."""
        if not (self.package and self.file):
            return None
        if self.simulated:
            kind: ApplicationKind = "robot-application" if self.kind == "robot" else "simulation-application"
            return simulated_fault(self.path, kind, self.application, (self.package, self.file), files)
        if {f"{self.package}/{self.file}", ros_launch_file(files, self.package, self.file)} & {*files}:
            return None
        allowed = f"a file in {self.application}'s bundle; it has no {self.package}/{self.file}"
        return Fault(path=f"{self.path}.launchFile", value=repr(self.file), allowed=allowed)


def simulated_fault(
    path: str, kind: ApplicationKind, application: str, launch: tuple[str, str], files: Collection[str]
) -> Fault | None:
    """Returns what is wrong with a launch configuration of a simulation; None if its bundle has what it names.

    Args:
        path: Where the document has it.
        kind: Of the application: what simulation applications launch is a module, whatever it is called.
        application: The application's name.
        launch: Its packageName and launchFile.
        files: Names of the files of its bundle.
    """
    (package, file), robot = launch, kind == "robot-application"
    found = simulated_file(files, package, file) if robot else None
    if found is None and (robot or module_file(package, file) not in files):
        thing = "a launch file or a module" if robot and names_ros_launch(file) else "a module"
        missing = looked_for(package, file) if robot else module_file(package, file)
        allowed = f"{thing} in {application}'s bundle; it has no {missing}"
        return Fault(path=f"{path}.launchFile", value=repr(file), allowed=allowed)
    if found and found == ros_launch_file(files, package, file) and ROBOT_XML not in files:
        allowed = (
            f"of a ROS package, a bundle that has {ROBOT_XML} beside the package: the robot's base, sensors and motors "
            f"as MuJoCo has them; copy {_EXAMPLE} there for a TurtleBot3, or change it for another base with two wheels"
        )
        return Fault(path=f"{path}.packageName", value=repr(package), allowed=allowed)
    return None


def check_driven_requests(spec: PipelineSpec, base: Path) -> None:  # noqa: ARG001 - as every check of a document
    """Refuses requests that lack an application, or do not say what of it is launched.

    Raises:
        DocumentError: With a fault for each.
    """
    faults = undriven_faults(spec.simulationBatch) if spec.simulationBatch else []
    if faults:
        raise DocumentError(faults)


def check_launch_files(spec: PipelineSpec, base: Path) -> None:
    """Refuses launch files that the document's own bundles do not have.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    own = {(each.kind, each.name): base / each.source for each in spec.applications}
    faults: list[Fault] = []
    files_of = cache(bundle_files)
    for launch in _launches(spec):
        folder = own.get((launch.kind, launch.application)) if launch.version in {None, LATEST} else None
        if folder and (fault := launch.fault(files_of(folder))):
            faults.append(fault)
    if faults:
        raise DocumentError(list(dict.fromkeys(faults)))


def unchecked_references(spec: PipelineSpec) -> list[str]:
    """Returns what a document refers to that only a store knows, each once, for a person."""
    own = {(each.kind, each.name) for each in spec.applications}
    found = [
        f"{launch.kind} application {launch.application}" + (f" version {launch.version}" if launch.version else "")
        for launch in _launches(spec)
        if launch.version not in {None, LATEST}
        or ((launch.kind, launch.application) not in own and shipped_application(launch.application) is None)
    ]
    if spec.gate and spec.gate.noWorseThan:
        found.append(f"version {spec.gate.noWorseThan.applicationVersion} to compare with")
    if spec.deployment and isinstance(spec.deployment.fleet, str):
        found.append(f"fleet {spec.deployment.fleet}")
    return list(dict.fromkeys(found))


def _launches(spec: PipelineSpec) -> Iterator[_Launch]:
    requests = spec.simulationBatch.createSimulationJobRequests if spec.simulationBatch else ()
    for number, request in enumerate(requests):
        uses = (("robot", request.robotApplications), ("simulation", request.simulationApplications))
        for kind, given in uses:
            for place, use in enumerate(given or ()):
                path = f"simulationBatch.createSimulationJobRequests[{number}].{kind}Applications[{place}].launchConfig"
                launched = (use.launchConfig.packageName or "", use.launchConfig.launchFile or "")
                name = reference_path(use.application)
                yield _Launch(path, kind, name, use.applicationVersion, *launched, simulated=True)
    for number, use in enumerate(spec.deployment.deploymentApplicationConfigs if spec.deployment else ()):
        path = f"deployment.deploymentApplicationConfigs[{number}].launchConfig"
        launched = (use.launchConfig.packageName, use.launchConfig.launchFile)
        name = reference_path(use.application)
        yield _Launch(path, "robot", name, use.applicationVersion, *launched, simulated=False)
