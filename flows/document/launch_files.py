"""What a document launches, held against the bundles that it brings along; the rest is known to a store alone."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from specs.arn import reference_path
from specs.base import Fault
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.driven_requests import undriven_faults
from specs.robomaker.bundle import LATEST
from tasks.applications.registry import shipped_application


class _Launch(NamedTuple):
    """A file that is launched, and of which application, as the document names it; empty if it does not say."""

    path: str
    kind: str
    application: str
    version: str | None
    file: str
    meant: str


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
    for launch in _launches(spec):
        folder = own.get((launch.kind, launch.application)) if launch.version in {None, LATEST} else None
        if folder and launch.file and not (folder / launch.file).is_file():
            allowed = f"{launch.meant} in {launch.application}'s bundle; it has no {launch.file}"
            faults.append(Fault(path=launch.path, value=repr(Path(launch.file).name), allowed=allowed))
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
                package, module = use.launchConfig.packageName, use.launchConfig.launchFile
                file = f"{package}/{module}.py" if package and module else ""
                name = reference_path(use.application)
                yield _Launch(f"{path}.launchFile", kind, name, use.applicationVersion, file, "a module")
    for number, use in enumerate(spec.deployment.deploymentApplicationConfigs if spec.deployment else ()):
        path = f"deployment.deploymentApplicationConfigs[{number}].launchConfig.launchFile"
        file = f"{use.launchConfig.packageName}/{use.launchConfig.launchFile}"
        yield _Launch(path, "robot", reference_path(use.application), use.applicationVersion, file, "a file")
