"""The policies of the bundles that a document brings along: one that does not fit its declaration is a fault."""

from pathlib import Path

from specs.arn import reference_path
from specs.base import Fault
from specs.bundle.launched_file import bundle_files, policy_file, simulated_file
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.robomaker.bundle import LATEST


def check_policies(spec: PipelineSpec, base: Path) -> None:
    """Refuses policies in ONNX in the document's own bundles that cannot be run as they are declared.

    What follows from ``robot.xml`` is left to ``simyard plan``, which loads it.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    own = {each.name: base / each.source for each in spec.applications if each.kind == "robot"}
    faults: list[Fault] = []
    for number, request in enumerate(spec.simulationBatch.createSimulationJobRequests if spec.simulationBatch else ()):
        for place, use in enumerate(request.robotApplications or ()):
            folder = own.get(reference_path(use.application)) if use.applicationVersion in {None, LATEST} else None
            launched = (use.launchConfig.packageName or "", use.launchConfig.launchFile or "")
            path = f"simulationBatch.createSimulationJobRequests[{number}].robotApplications[{place}].launchConfig"
            if folder and (refusal := _refusal(folder, *launched)):
                faults.append(Fault(path=f"{path}.launchFile", value=repr(launched[1]), allowed=refusal))
    if faults:
        raise DocumentError(faults)


def _refusal(folder: Path, package: str, launch_file: str) -> str:
    name = policy_file(package, launch_file)
    if simulated_file(bundle_files(folder), package, launch_file) != name:
        return ""
    from tasks.simulate.host.policy.policy_check import check_policy  # noqa: PLC0415 - few documents have a policy
    from tasks.simulate.refusal import RobotRefused  # noqa: PLC0415

    try:
        check_policy(folder, name)
    except RobotRefused as refused:
        return str(refused)
    return ""
