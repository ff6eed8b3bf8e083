"""What `simyard validate` looks at: what is launched, and in a document's own bundles files, robots and metrics."""

from collections.abc import Callable
from pathlib import Path

from flows.document.launch_files import check_driven_requests, check_launch_files
from flows.document.measured_names import check_own_names
from flows.document.policy_files import check_policies
from flows.document.robot_files import check_robot_files
from flows.document.ros_launches import own_ros_launches, ros_faults, ros_notes
from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec

_CHECKS: tuple[Callable[[PipelineSpec, Path], None], ...] = (
    check_driven_requests,
    check_launch_files,
    check_robot_files,
    check_policies,
    check_own_names,
)


def check_own_bundles(spec: PipelineSpec, base: Path) -> list[str]:
    """Returns what is to be said of a document's own bundles, and refuses one whose bundles do not fit it.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With every fault.
    """
    faults: list[Fault] = []
    for check in _CHECKS:
        try:
            check(spec, base)
        except DocumentError as exc:
            faults += exc.faults
    launches = own_ros_launches(spec, base)
    if faults := list(dict.fromkeys([*faults, *ros_faults(launches)])):
        raise DocumentError(faults)
    return ros_notes(launches)
