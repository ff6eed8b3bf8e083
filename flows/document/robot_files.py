"""The robots of the bundles that a document brings along: their MJCF is at fault like any line of the document."""

from pathlib import Path

from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.simulate.application.mjcf_check import check_mjcf
from tasks.simulate.refusal import MjcfRefused


def check_robot_files(spec: PipelineSpec, base: Path) -> None:
    """Refuses a document one of whose own bundles holds a robot that MuJoCo is not given.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each such bundle.
    """
    faults: list[Fault] = []
    for number, source in enumerate(spec.applications):
        robot = base / source.source / "robot.xml"
        try:
            if source.kind == "robot" and robot.exists():
                check_mjcf(robot)
        except MjcfRefused as refused:
            faults.append(Fault(path=f"applications[{number}].source", value=source.source, allowed=str(refused)))
    if faults:
        raise DocumentError(faults)
