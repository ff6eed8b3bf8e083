"""Drafts of robots and worlds: what a launch file that starts Gazebo describes, as the files that Simyard reads.

Both the launch file and the robot's description are an application's own: they are read in its confinement.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from flows.pipeline.world_imports import answer_apart
from specs.bundle_files import ROS_FILE
from specs.errors import DocumentError, LaunchRefused
from tasks.applications.robot_draft import DraftRequest, RobotDraft
from tasks.ros.launch.gazebo_launch import GazeboLaunch
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.simulate.sandbox.launch_check import check_launch_file

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


def draft_of_launch(source: LaunchSource, variables: Mapping[str, str]) -> DraftedRobot:
    """Returns the draft of the robot that a launch file spawns.

    Args:
        source: The launch file.
        variables: Environment variables, which ``$(env)`` and ``$(optenv)`` read.

    Raises:
        DocumentError: The launch file cannot be read, spawns no robot, or its description makes none.
    """
    report = check_launch_file(source, [dict(variables)], own=True)
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
