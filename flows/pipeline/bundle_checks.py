"""A document held against the bundles that it brings along: launch files, robots, policies, and metrics.

The rest is known to a store alone; see `flows.pipeline.references`.
"""

import stat
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from flows.pipeline.launch_notes import (
    command_fault,
    environments,
    report_lines,
    ros_launch_faults,
    topic_lines,
)
from specs.arn import reference_path
from specs.base import Fault
from specs.errors import BundleRefused, DocumentError
from specs.launched_file import (
    IMAGE_FILE,
    bundle_files,
    looked_for,
    module_file,
    names_ros_launch,
    policy_file,
    ros_launch_file,
    simulated_file,
)
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate, metric_faults
from specs.pipeline.section_requests import undriven_faults
from specs.pipeline.simulation_section import LocalFleet, SimulationBatch
from specs.program_file import HEAD_BYTES
from specs.robomaker.bundle import LATEST, ApplicationKind
from specs.settings import chosen_workers
from tasks.applications.registry import shipped_application, unpack
from tasks.deploy.rollout.resolved_request import launch_files, outside_package, program_fault
from tasks.simulate.application.declared_metrics import declared_metrics
from tasks.simulate.application.mjcf_check import RobotRefused, refusal_lines
from tasks.simulate.application.module_check import module_fault
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.image_files import image_root, missing_program, read_image

if TYPE_CHECKING:
    from tasks.ros.launch.launch_plan import LaunchSource
    from tasks.simulate.sandbox.launch_check import LaunchReport

ROBOT_XML = "robot.xml"
_EXAMPLE = "examples/ros/turtlebot3/robot.xml"
_FACTORIES = {"robot": ("controller", "controllers"), "simulation": ("scenario",)}


class _Launch(NamedTuple):
    """What is launched, and of which application, as the document names it; empty if it does not say."""

    path: str
    kind: str
    application: str
    version: str | None
    package: str
    file: str
    simulated: bool
    alone: bool = False
    variables: Mapping[str, str] = MappingProxyType({})
    command: tuple[str, ...] | None = None

    def fault(self, files: Collection[str]) -> Fault | None:
        """Returns what is wrong with it, given the files of its bundle."""
        if not (self.package and self.file) and not self.command:
            return None
        if self.simulated:
            kind: ApplicationKind = "robot-application" if self.kind == "robot" else "simulation-application"
            launched = (self.package, self.file)
            return simulated_fault(self.path, kind, self.application, launched, files, alone=self.alone)
        named = {f"{self.package}/{self.file}", ros_launch_file(files, self.package, self.file), IMAGE_FILE}
        if named & {*files}:  # into an image `check_images` looks
            return None
        own = f"{self.package}/{self.file}"
        missing = looked_for(files, self.package, self.file) if names_ros_launch(self.file) else own
        allowed = f"a file in {self.application}'s bundle; it has no {missing}"
        return Fault(path=f"{self.path}.launchFile", value=repr(self.file), allowed=allowed)


def simulated_fault(
    path: str,
    kind: ApplicationKind,
    application: str,
    launch: tuple[str, str],
    files: Collection[str],
    *,
    alone: bool = False,
) -> Fault | None:
    """Returns what is wrong with a launch configuration of a simulation; None if its bundle has what it names.

    Args:
        path: Where the document has it.
        kind: Of the application: a simulation application that has both launches a module, not a launch file of ROS.
        application: The application's name.
        launch: Its packageName and launchFile.
        files: Names of the files of its bundle.
        alone: Whether there is no robot application, so that this one brings the robot.
    """
    (package, file), robot = launch, kind == "robot-application"
    if IMAGE_FILE in files:
        return _image_fault(path, application, launch, files, drives=robot or alone)
    if not file:
        allowed = f"the module to launch, in packageName: {application} is no container image, which a command is for"
        return Fault(path=f"{path}.launchFile", value="none", allowed=allowed)
    found, module = simulated_file(files, package, file), module_file(package, file)
    if not robot and (module in files or not names_ros_launch(file)):
        found = module if module in files else None
    if found is None:
        thing = "a launch file or a module" if names_ros_launch(file) else "a module"
        missing = looked_for(files, package, file) if robot or names_ros_launch(file) else module
        allowed = f"{thing} in {application}'s bundle; it has no {missing}"
        return Fault(path=f"{path}.launchFile", value=repr(file), allowed=allowed)
    drives = robot or alone
    if drives and found == ros_launch_file(files, package, file) and ROBOT_XML not in files:
        allowed = (
            f"of a ROS package, a bundle that has {ROBOT_XML} beside the package: the robot's base, sensors and motors "
            f"as MuJoCo has them; copy {_EXAMPLE} there for a TurtleBot3, change it for another base with two "
            "wheels, or have one drafted of the robot that a launch file spawns in Gazebo: simyard app draft"
        )
        return Fault(path=f"{path}.packageName", value=repr(package), allowed=allowed)
    return None


def _image_fault(
    path: str, application: str, launch: tuple[str, str], files: Collection[str], *, drives: bool
) -> Fault | None:
    """Returns what a container image lacks that is to drive a robot, or to judge one."""
    if drives:
        beside = f"`robot: FOLDER` beside its source, a folder with {ROBOT_XML}; copy {_EXAMPLE} for a TurtleBot3"
        allowed = f"a container image with /simyard/{ROBOT_XML}, or {beside}"
        return None if ROBOT_XML in files else Fault(path=path, value=application, allowed=allowed)
    if not launch[1] or names_ros_launch(launch[1]):
        return None
    allowed = f"what {application}'s image runs to judge: a command, or a launch file of ROS; a module is in a folder"
    return Fault(path=f"{path}.launchFile", value=repr(launch[1]), allowed=allowed)


def _raise_all(faults: Iterable[Fault]) -> None:
    if each := list(dict.fromkeys(faults)):
        raise DocumentError(each)


def check_driven_requests(spec: PipelineSpec, base: Path) -> None:  # noqa: ARG001 - as every check of a document
    """Refuses requests that lack an application, or do not say what of it is launched.

    Raises:
        DocumentError: With a fault for each.
    """
    _raise_all(undriven_faults(spec.simulationBatch) if spec.simulationBatch else [])


def _own_launches(spec: PipelineSpec, base: Path) -> Iterator[tuple[_Launch, Path]]:
    """Yields what is launched of the document's own bundles, and their folders."""
    own = {(each.kind, each.name): base / each.source for each in spec.applications}
    for launch in _launched(spec):
        folder = own.get((launch.kind, launch.application)) if launch.version in {None, LATEST} else None
        if folder:
            yield launch, folder


def check_launch_files(spec: PipelineSpec, base: Path) -> None:
    """Refuses launch files that the document's own bundles do not have.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    files_of, launches = cache(bundle_files), _own_launches(spec, base)
    _raise_all(fault for launch, folder in launches if (fault := launch.fault(files_of(folder))))


def check_programs(spec: PipelineSpec, base: Path) -> None:
    """Refuses files of the document's own bundles that robots are to start, and that do not start.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    own, faults = {each.name: each.source for each in spec.applications if each.kind == "robot"}, list[Fault]()
    section = spec.deployment
    here = section is not None and isinstance(section.fleet, LocalFleet) and section.fleet.localAgents > 0
    for number, use in enumerate(section.deploymentApplicationConfigs if section else ()):
        source = own.get(reference_path(use.application)) if use.applicationVersion in {None, LATEST} else None
        if source is None or (base / source / IMAGE_FILE).is_file():  # `check_images` looks into it
            continue
        launch, where = use.launchConfig, f"deployment.deploymentApplicationConfigs[{number}].launchConfig"
        outside = [*outside_package(launch, where)]
        faults += outside
        for field, name in launch_files(launch).items():
            # `check_launch_files` names a launch file that is not there, and knows those of ROS.
            if field == "launchFile" and (names_ros_launch(name) or not (base / source / name).is_file()):
                continue
            path = f"{where}.{field}"
            if path not in {fault.path for fault in outside} and (why := _own_fault(base, source, name, here=here)):
                allowed = f"a file that can be started; {why}"
                faults.append(Fault(path=path, value=repr(getattr(launch, field)), allowed=allowed))
    _raise_all(faults)


def _own_fault(base: Path, source: str, name: str, *, here: bool) -> str:
    path, shown = base / source / name, f"{source}/{name}"
    if not path.is_file():
        return program_fault(shown, None, (), executable=False, here=here)
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return program_fault(shown, head, (), executable=bool(path.stat().st_mode & stat.S_IXUSR), here=here)


def check_images(spec: PipelineSpec, base: Path) -> None:
    """Refuses container images of the document's own that do not have what is launched.

    Raises:
        DocumentError: With a fault for each.
    """
    faults: list[Fault] = []
    for launch, folder in _own_launches(spec, base):
        try:
            image, root, command = read_image(folder), image_root(folder), launch.command or ()
            words = image.words(launch.package, launch.file, command) if image else ()
            if image and root and (why := missing_program(root, image, words, ros=launch.simulated)):
                faults.append(command_fault(launch.path, launch.file, command, why))
        except BundleRefused as exc:
            allowed = f"a container image that can be run here; {exc}"
            faults.append(Fault(path=launch.path, value=launch.application, allowed=allowed))
    _raise_all(faults)


def check_modules(spec: PipelineSpec, base: Path) -> None:
    """Refuses controllers and scenarios in the document's own bundles that would not import; nothing of them is run.

    Libraries are looked for where this process simulates; workers elsewhere may have others.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    faults, files_of = list[Fault](), cache(bundle_files)
    for launch, folder in _own_launches(spec, base):
        name, files = module_file(launch.package, launch.file), files_of(folder)
        found = simulated_file(files, launch.package, launch.file) if launch.kind == "robot" else name
        if not launch.simulated or found != name or name not in files:
            continue
        factories = _FACTORIES[launch.kind]
        if why := module_fault(folder, launch.package, launch.file, factories, installed=not chosen_workers()):
            allowed = f"a module in Python that can be imported; {why}"
            faults.append(Fault(path=f"{launch.path}.launchFile", value=repr(launch.file), allowed=allowed))
    _raise_all(faults)


def check_confinement(spec: PipelineSpec, base: Path) -> None:
    """Refuses the document's own bundles that this process would not let run, as nothing shuts them in.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    own = dict.fromkeys(
        (launch.application, folder) for launch, folder in _own_launches(spec, base) if launch.simulated
    )
    _require_confined(own)


def check_planned_confinement(plan: BatchPlan, store: Store) -> None:
    """Refuses applications of a batch that this process would not let run, before anything else does.

    Args:
        plan: The batch.
        store: Where its bundles are.

    Raises:
        DocumentError: With a fault for each.
    """
    launched = (launch for template in plan.templates for launch in (template.robot, template.scenario))
    named = dict.fromkeys((launch.name, launch.digest) for launch in launched)
    _require_confined((name, unpack(store, digest, cache_folder() / "bundles")) for name, digest in named)


def _require_confined(bundles: Iterable[tuple[str, Path]]) -> None:
    """Lets bundles pass, by their names; where workers elsewhere simulate, they are asked when it comes to that."""
    from tasks.simulate.sandbox.confinement import confinement_faults  # noqa: PLC0415 - as in own_ros_launches

    _raise_all([] if chosen_workers() else confinement_faults(bundles))


def unchecked_references(spec: PipelineSpec) -> list[str]:
    """Returns what a document refers to that only a store knows, each once, for a person."""
    own = {(each.kind, each.name) for each in spec.applications}
    found = [
        f"{launch.kind} application {launch.application}" + (f" version {launch.version}" if launch.version else "")
        for launch in _launched(spec)
        if launch.version not in {None, LATEST}
        or ((launch.kind, launch.application) not in own and shipped_application(launch.application) is None)
    ]
    if spec.gate and spec.gate.noWorseThan:
        found.append(f"version {spec.gate.noWorseThan.applicationVersion} to compare with")
    if spec.search and spec.search.against:
        found.append(f"version {spec.search.against} that the search is against")
    if spec.deployment and isinstance(spec.deployment.fleet, str):
        found.append(f"fleet {spec.deployment.fleet}")
    return list(dict.fromkeys(found))


def _launched(spec: PipelineSpec) -> Iterator[_Launch]:
    requests = spec.simulationBatch.createSimulationJobRequests if spec.simulationBatch else ()
    for number, request in enumerate(requests):
        uses = (("robot", request.robotApplications), ("simulation", request.simulationApplications))
        for kind, given in uses:
            for place, use in enumerate(given or ()):
                path = f"simulationBatch.createSimulationJobRequests[{number}].{kind}Applications[{place}].launchConfig"
                launched = (use.launchConfig.packageName or "", use.launchConfig.launchFile or "")
                name = reference_path(use.application)
                alone, variables = not request.robotApplications, use.launchConfig.environmentVariables or {}
                version = use.applicationVersion
                command = None if launched[1] else use.launchConfig.command
                yield _Launch(path, kind, name, version, *launched, True, alone, variables, command)  # noqa: FBT003 - fields
    for number, use in enumerate(spec.deployment.deploymentApplicationConfigs if spec.deployment else ()):
        path = f"deployment.deploymentApplicationConfigs[{number}].launchConfig"
        launched = (use.launchConfig.packageName, use.launchConfig.launchFile)
        name = reference_path(use.application)
        yield _Launch(path, "robot", name, use.applicationVersion, *launched, simulated=False)


def check_robot_files(spec: PipelineSpec, base: Path) -> None:
    """Refuses a document one of whose own bundles holds a robot that MuJoCo is not given, or that no engine takes.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With each fault of each such bundle.
    """
    faults: list[Fault] = []
    for number, source in enumerate(spec.applications):
        robot = base / source.source / "robot.xml"
        try:
            if source.kind == "robot" and robot.exists():
                from tasks.simulate.application.robot_file import read_robot_mjcf  # noqa: PLC0415 - it imports MuJoCo

                read_robot_mjcf(robot)
        except RobotRefused as refused:
            path = f"applications[{number}].source"
            faults += [Fault(path=path, value=source.source, allowed=why) for why in refusal_lines(str(refused))]
    _raise_all(faults)


def check_policies(spec: PipelineSpec, base: Path) -> None:
    """Refuses policies in ONNX in the document's own bundles that cannot be run as they are declared.

    What follows from ``robot.xml`` is left to ``simyard plan``, which loads it.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    faults = [
        Fault(path=f"{launch.path}.launchFile", value=repr(launch.file), allowed=refusal)
        for launch, folder in _own_launches(spec, base)
        if launch.simulated and launch.kind == "robot"
        if (refusal := _policy_refusal(folder, launch.package, launch.file))
    ]
    _raise_all(faults)


def _policy_refusal(folder: Path, package: str, launch_file: str) -> str:
    name = policy_file(package, launch_file)
    if simulated_file(bundle_files(folder), package, launch_file) != name:
        return ""
    from tasks.simulate.host.policy_check import check_policy  # noqa: PLC0415 - few documents have a policy

    try:
        check_policy(folder, name)
    except RobotRefused as refused:
        return str(refused)
    return ""


def check_own_names(spec: PipelineSpec, base: Path) -> None:
    """Refuses metrics that no scenario measures, where the document brings all of its scenarios along.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each rule about such a metric.
    """
    if spec.gate is None or spec.simulationBatch is None or not spec.gate.quantiles:
        return
    own = {each.name: base / each.source for each in spec.applications if each.kind == "simulation"}
    used = _scenarios(spec.simulationBatch)
    judges = [launch for launch in _launched(spec) if launch.kind == "simulation" and launch.application in own]
    files_of = cache(bundle_files)
    if any(
        each.command
        or IMAGE_FILE in files_of(own[each.application])
        or _starts_nodes(each, files_of(own[each.application]))
        for each in judges
    ):
        return  # any tag with a number is a metric
    if used and used <= own.keys():
        _require_metrics(spec.gate, _declared_metrics(own[name] for name in sorted(used)))


def check_planned_names(gate: Gate | None, plan: BatchPlan, store: Store) -> None:
    """Refuses metrics that no scenario of a batch measures.

    Args:
        gate: The document's gate.
        plan: The batch.
        store: Where its bundles are.

    Raises:
        DocumentError: With a fault for each rule about such a metric.
    """
    if gate is None or not gate.quantiles:
        return
    _require_metrics(gate, planned_names(plan, store))


def planned_names(plan: BatchPlan, store: Store) -> frozenset[str] | None:
    """Returns the names of all metrics that the scenarios of a batch measure; None where that is not known.

    Args:
        plan: The batch.
        store: Where its bundles are.

    Raises:
        ObjectNotFound: A bundle is gone.
    """
    if any(template.scenario.starts_nodes for template in plan.templates):
        return None  # any tag with a number is one
    digests = dict.fromkeys(template.scenario.digest for template in plan.templates)
    return _declared_metrics(unpack(store, digest, cache_folder() / "bundles") for digest in digests)


def _scenarios(section: SimulationBatch) -> set[str]:
    """Returns the names of a batch's scenarios; one that is not the document's own is named so that it never is."""
    uses = [use for request in section.createSimulationJobRequests for use in request.simulationApplications or ()]
    return {
        reference_path(use.application) if use.applicationVersion in {None, LATEST} else f"{use.application}@"
        for use in uses
    }


def _declared_metrics(bundles: Iterable[Path]) -> frozenset[str] | None:
    found = [declared_metrics(bundle) for bundle in bundles]
    known = [names for names in found if names is not None]
    # Where one is not known, it may measure anything.
    return frozenset[str]().union(*known) if len(known) == len(found) else None


def _require_metrics(gate: Gate, known: frozenset[str] | None) -> None:
    _raise_all(metric_faults(gate, sorted(known)) if known is not None else [])


class OwnLaunch(NamedTuple):
    """A ROS launch file of a document's own bundle, where the document names it, and what roslaunch says of it."""

    path: str
    source: "LaunchSource"
    report: "LaunchReport"


def ros_faults(launches: Sequence[OwnLaunch]) -> list[Fault]:
    """Returns a fault for each launch file that roslaunch refuses, if ROS is here, and for each wrong ``ros.yaml``."""
    return [fault for each in launches for fault in ros_launch_faults(each.path, each.source, each.report)]


def ros_notes(launches: Sequence[OwnLaunch]) -> list[str]:
    """Returns what is to be said of launch files that is no fault of the document."""
    lines = [line for each in launches for line in report_lines(each.source, each.report)]
    return list(dict.fromkeys([*lines, *topic_lines([each.report for each in launches])]))


def own_ros_launches(spec: PipelineSpec, base: Path) -> list[OwnLaunch]:
    """Returns the ROS launch files that a document simulates of its own bundles; each is read once."""
    own = {(each.kind, each.name): base / each.source for each in spec.applications}
    read: dict[LaunchSource, LaunchReport] = {}
    found: list[OwnLaunch] = []
    for path, source, variables in _ros_sources(spec, own):
        if source not in read:
            from tasks.simulate.sandbox.launch_check import check_launch_file  # noqa: PLC0415

            read[source] = check_launch_file(source, environments(variables, _sweep(spec)), own=True)
        found.append(OwnLaunch(path, source, read[source]))
    return found


def _ros_sources(
    spec: PipelineSpec, own: Mapping[tuple[str, str], Path]
) -> Iterator["tuple[str, LaunchSource, dict[str, str]]"]:
    for launch in _launched(spec):
        folder = own.get((launch.kind, launch.application)) if launch.version in {None, LATEST} else None
        if folder is None or not launch.simulated or not _starts_nodes(launch, bundle_files(folder)):
            continue
        from tasks.ros.launch.launch_plan import LaunchSource  # noqa: PLC0415 - few documents have a ROS launch file

        yield launch.path, LaunchSource(folder.resolve(), launch.package, launch.file), dict(launch.variables)


def _starts_nodes(launch: _Launch, files: Collection[str]) -> bool:
    """Returns whether a launch file of ROS is meant: of a simulation application, a module of that name is."""
    if ros_launch_file(files, launch.package, launch.file) is None:
        return False
    return launch.kind == "robot" or module_file(launch.package, launch.file) not in files


def _sweep(spec: PipelineSpec) -> dict[str, tuple[str, ...]]:
    section = spec.simulationBatch
    return {name: tuple(values) for name, values in section.matrix.environmentVariables.items()} if section else {}


_CHECKS: tuple[Callable[[PipelineSpec, Path], None], ...] = (
    check_driven_requests,
    check_launch_files,
    check_programs,
    check_images,
    check_modules,
    check_robot_files,
    check_policies,
    check_own_names,
    check_confinement,
)


def check_own_bundles(
    spec: PipelineSpec, base: Path, more: Sequence[Callable[[PipelineSpec, Path], object]] = ()
) -> list[str]:
    """Returns what is to be said of a document's own bundles, and refuses one whose bundles do not fit it.

    Args:
        spec: The document.
        base: Folder that relative paths start from.
        more: Other checks, whose faults are told with these.

    Raises:
        DocumentError: With every fault.
    """
    faults: list[Fault] = []
    for check in (*_CHECKS, *more):
        try:
            check(spec, base)
        except DocumentError as exc:
            faults += exc.faults
    launches = own_ros_launches(spec, base)
    if faults := list(dict.fromkeys([*faults, *ros_faults(launches)])):
        raise DocumentError(faults)
    return ros_notes(launches)
