"""Drafts of robots and worlds: what a launch file that starts Gazebo describes, as the files that Simyard reads.

Both the launch file and the robot's description are an application's own: they are read in its confinement.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from flows.pipeline.world_imports import answer_apart
from specs.arn import reference_path
from specs.base import Fault
from specs.errors import BundleRefused, DocumentError, LaunchRefused
from specs.launched_file import bundle_files, module_file, names_ros_launch, ros_launch_file
from specs.pipeline.document import PipelineSpec
from specs.pipeline.simulation_section import PipelineRobotApplication, PipelineSimulationApplication
from specs.robomaker.bundle import LATEST
from specs.ros_robot import ROS_FILE, DraftRequest, RobotDraft
from tasks.applications.registry import BUNDLE_ERRORS, pack_bundle, unpack
from tasks.ros.launch.gazebo_launch import GazeboLaunch
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.archives import list_bundle_files
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.container_image import image_bundle, is_image_source

_MODULE = "tasks.applications.robot_draft"
_ROBOT_XML = "robot.xml"


class DraftedRobot(NamedTuple):
    """A robot as a launch file describes it.

    Attributes:
        gazebo: What the launch file asks of Gazebo.
        draft: The files.
    """

    gazebo: GazeboLaunch
    draft: RobotDraft


def draft_of_launch(source: LaunchSource, variables: Mapping[str, str], *, own: bool = True) -> DraftedRobot:
    """Returns the draft of the robot that a launch file spawns.

    Args:
        source: The launch file.
        variables: Environment variables, which ``$(env)`` and ``$(optenv)`` read.
        own: Whether the bundle is the user's own; where nothing shuts it in, no other one is read.

    Raises:
        DocumentError: The launch file cannot be read, spawns no robot, or its description makes none.
    """
    from tasks.simulate.sandbox.launch_check import check_launch_file  # noqa: PLC0415 - few documents need it

    report = check_launch_file(source, [dict(variables)], own=own)
    gazebo, named = report.gazebo, f"{source.package} {source.launch_file}"
    why = report.unread or "; ".join(report.refusals) or ("" if report.has_ros else report.ros)
    if gazebo is None or gazebo.description is None:
        missing = "; ".join(gazebo.findings) if gazebo else "; ".join(report.missing)
        allowed = (
            f"a launch file that spawns a robot in Gazebo, with its description; {why or missing or 'this has none'}"
        )
        raise DocumentError.of("launchFile", named, allowed, source="simyard")
    asked = DraftRequest(bundle=source.bundle, description=gazebo.description, model_folders=gazebo.model_folders)
    try:
        draft = RobotDraft.model_validate_json(answer_apart(_MODULE, asked.model_dump_json(), [source.bundle]))
    except (LaunchRefused, ValidationError) as exc:
        said = str(exc) if isinstance(exc, LaunchRefused) else "it says nothing that is an answer"
        draft = RobotDraft(refused=f"the process that reads it: {said}")
    if draft.refused:
        raise DocumentError.of("launchFile", named, draft.refused, source="simyard")
    return DraftedRobot(gazebo, draft)


def write_draft(draft: RobotDraft, folder: Path) -> list[Path]:
    """Writes a draft's files, and returns them; what somebody wrote before is left as it is.

    Raises:
        DocumentError: One of them is there.
    """
    files = {folder / _ROBOT_XML: draft.robot_xml, folder / ROS_FILE: draft.ros_yaml}
    there = [str(path) for path in files if path.exists()]
    if there:
        allowed = "a folder without them: name another one, or take them away"
        raise DocumentError.of("--out", ", ".join(there), allowed, source="simyard")
    folder.mkdir(parents=True, exist_ok=True)
    for path, text in files.items():
        path.write_text(text)
    return list(files)


def world_entry(gazebo: GazeboLaunch, base: Path) -> str:
    """Returns the entry of a document's ``worlds`` for the world of a launch file; empty if it has none.

    Args:
        gazebo: What the launch file asks of Gazebo.
        base: The folder that the document lies in.
    """
    if gazebo.world is None:
        return ""
    parts = [f"name: {gazebo.world.stem}", f"source: {_relative(gazebo.world, base)}"]
    if gazebo.model_folders:
        parts.append(f"models: [{', '.join(_relative(each, base) for each in gazebo.model_folders)}]")
    if gazebo.spawn:
        parts.append(f"start: [{gazebo.spawn.x_m:g}, {gazebo.spawn.y_m:g}, {gazebo.spawn.yaw_rad:g}]")
    return f"- {{{', '.join(parts)}}}"


def _relative(path: Path, base: Path) -> str:
    real, own = path.resolve(), base.resolve()
    return str(real.relative_to(own) if real.is_relative_to(own) else real)


_KEPT = 32
_Use = PipelineRobotApplication | PipelineSimulationApplication


class DraftedDocument(NamedTuple):
    """A document whose own robots all have a ``robot.xml``, as far as one could be drafted.

    Attributes:
        spec: The document; a bundle that had none is replaced by a copy with its draft.
        notes: What is to be said of drafts.
    """

    spec: PipelineSpec
    notes: tuple[str, ...] = ()


def with_drafts(spec: PipelineSpec, base: Path) -> DraftedDocument:
    """Returns a document whose own bundles without ``robot.xml`` have one drafted, if a launch file spawns a robot.

    Container images are bundles from here on.

    The robot is that of the simulation application's launch file, or of the robot application's own. Where none can be
    drafted, the bundle stays as it is, and is refused for what it lacks.

    Args:
        spec: The document.
        base: Folder that relative paths start from.
    """
    spec = with_images(spec, base)
    own = {(each.kind, each.name): (base / each.source).resolve() for each in spec.applications}
    drafted: dict[tuple[str, str], DraftedRobot] = {}
    for request in spec.simulationBatch.createSimulationJobRequests if spec.simulationBatch else ():
        uses: list[tuple[str, _Use]] = [("robot", each) for each in request.robotApplications or ()]
        uses += [("simulation", each) for each in request.simulationApplications or ()]
        key = (uses[0][0], _name(uses[0][1])) if uses else ("", "")
        folder = own.get(key)
        if folder is None or key in drafted or not _lacks_robot(uses[0][1], folder):
            continue
        launched = [each for each in (_launched(use, own.get((kind, _name(use)))) for kind, use in uses) if each]
        found = next(_drafts(reversed(launched)), None)
        if found:
            drafted[key] = found
    if not drafted:
        return DraftedDocument(spec)
    applications = tuple(
        each.model_copy(update={"source": str(_with_files(own[key], drafted[key].draft))}) if key in drafted else each
        for each in spec.applications
        for key in [(each.kind, each.name)]
    )
    notes = [line for (_, name), found in drafted.items() for line in _lines(name, found.draft)]
    return DraftedDocument(spec.model_copy(update={"applications": applications}), (*notes,))


def with_images(spec: PipelineSpec, base: Path) -> PipelineSpec:
    """Returns a document whose container images are bundles in the cache.

    Raises:
        DocumentError: A source is no image, or one that cannot be used.
    """
    images = {number for number, each in enumerate(spec.applications) if is_image_source(each.source, base)}
    if not images:
        return spec
    faults, applications = list[Fault](), list(spec.applications)
    for number in sorted(images):
        each = applications[number]
        try:
            folder = image_bundle(each.source, base, base / each.robot if each.robot else None)
            applications[number] = each.model_copy(update={"source": str(folder)})
        except BundleRefused as exc:
            allowed = f"a container image that can be run here; {exc}"
            faults.append(Fault(path=f"applications[{number}].source", value=each.source, allowed=allowed))
    if faults:
        raise DocumentError(faults)
    return spec.model_copy(update={"applications": tuple(applications)})


def with_store_drafts(plan: BatchPlan, store: Store) -> BatchPlan:
    """Returns a plan whose bundles without ``robot.xml`` are copies with the draft of what a launch file spawns.

    The versions stay as they are: a copy is a bundle of its own, which nobody published, and no pass of it ships them.

    Args:
        plan: The batch.
        store: Where the bundles are, and the copies are put.
    """
    templates = tuple(_drafted_template(each, store) for each in plan.templates)
    return plan if templates == plan.templates else plan.model_copy(update={"templates": templates})


def _drafted_template(template: JobTemplate, store: Store) -> JobTemplate:
    robot, uses = template.robot, [(template.robot, template.environment)]
    if not robot.starts_nodes or robot.command is not None:
        return template
    try:
        if _ROBOT_XML in list_bundle_files(store, robot.digest):
            return template
        judged = template.scenario.starts_nodes and template.scenario.command is None
        uses += [(template.scenario, template.judge_variables)] if judged else []
        folders = {use.digest: unpack(store, use.digest, cache_folder() / "bundles") for use, _ in uses}
    except BUNDLE_ERRORS:
        return template  # which is refused for that elsewhere
    launched = [
        (LaunchSource(folders[use.digest], use.package, use.launch_file), tuple(sorted(own.items())))
        for use, own in reversed(uses)
    ]
    found = next(_drafts(launched, own=False), None)
    if found is None:
        return template
    made = pack_bundle(store, "X86_64", _with_files(folders[robot.digest], found.draft))
    copy = robot.model_copy(update={"digest": made.digest})
    scenario = copy if template.alone else template.scenario
    return template.model_copy(update={"robot": copy, "scenario": scenario})


def _name(use: _Use) -> str:
    return reference_path(use.application)


def _lacks_robot(use: _Use, folder: Path) -> bool:
    """Returns whether a bundle is driven by a launch file, and has no robot."""
    package, name = use.launchConfig.packageName or "", use.launchConfig.launchFile or ""
    if not names_ros_launch(name) or (folder / _ROBOT_XML).exists():
        return False  # most documents: their bundles are not gone through
    return ros_launch_file(bundle_files(folder), package, name) is not None


def _launched(use: _Use, folder: Path | None) -> tuple[LaunchSource, tuple[tuple[str, str], ...]] | None:
    """Returns the launch file of ROS that one of the document's own bundles is used with, and its variables."""
    package, name = use.launchConfig.packageName or "", use.launchConfig.launchFile or ""
    if folder is None or use.applicationVersion not in {None, LATEST}:
        return None
    files = bundle_files(folder)
    if ros_launch_file(files, package, name) is None or module_file(package, name) in files:
        return None
    return LaunchSource(folder, package, name), tuple(sorted((use.launchConfig.environmentVariables or {}).items()))


def _drafts(
    launched: Iterable[tuple[LaunchSource, tuple[tuple[str, str], ...]]], *, own: bool = True
) -> Iterator[DraftedRobot]:
    for source, variables in launched:
        found = _draft_once(source, variables, _fingerprint(source.bundle), own=own)
        if found:
            yield found


@lru_cache(maxsize=_KEPT)
def _draft_once(
    source: LaunchSource, variables: tuple[tuple[str, str], ...], _state: str, *, own: bool
) -> DraftedRobot | None:
    """Returns a draft, made once for each state of a bundle; None where its launch file spawns no robot."""
    try:
        return draft_of_launch(source, dict(variables), own=own)
    except DocumentError:
        return None  # the bundle is refused for having no robot.xml, which says how to have one


def _fingerprint(folder: Path) -> str:
    found = ((each.relative_to(folder).as_posix(), each.lstat()) for each in sorted(folder.rglob("*")))
    told = "\n".join(f"{name} {state.st_size} {state.st_mtime_ns} {state.st_mode}" for name, state in found)
    return hashlib.sha256(told.encode()).hexdigest()


def _with_files(folder: Path, draft: RobotDraft) -> Path:
    """Returns a copy of a bundle with the files of a draft that it lacks, in the cache."""
    name = hashlib.sha256(f"{folder} {_fingerprint(folder)} {draft.robot_xml} {draft.ros_yaml}".encode()).hexdigest()
    place = cache_folder() / "drafts" / name
    if place.is_dir():
        return place
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent) as making:
        copy = Path(making) / "bundle"
        shutil.copytree(folder, copy, symlinks=True)
        copy.chmod(0o755)  # what was unpacked is not to be written to
        for file, text in ((_ROBOT_XML, draft.robot_xml), (ROS_FILE, draft.ros_yaml)):
            if not (copy / file).exists():
                (copy / file).write_text(text)
        try:
            copy.rename(place)
        except OSError:
            if not place.is_dir():  # another process made the same
                raise
    return place


def _lines(name: str, draft: RobotDraft) -> Sequence[str]:
    first = f"{name} has no {_ROBOT_XML}: one is drafted of what its launch file spawns; simyard app draft writes it"
    return [first, *(f"{name}: draft: {each}" for each in draft.findings)]
