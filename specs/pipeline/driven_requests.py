"""What a request must say so that an episode can be driven, which RoboMaker's interface leaves open."""

from collections.abc import Iterator

from specs.base import Fault
from specs.pipeline.simulation_section import PipelineJobRequest, SimulationBatch

REQUESTS = "simulationBatch.createSimulationJobRequests"


def undriven_faults(section: SimulationBatch) -> list[Fault]:
    """Returns a fault for each application that a request lacks, and for what its launch configuration does not say.

    RoboMaker took a request without a robot, and a launch configuration with a command instead
    (docs/reference/robomaker.md, sections 3 and 10). An episode needs both applications, and a module of each.
    """
    requests = enumerate(section.createSimulationJobRequests)
    return [fault for number, request in requests for fault in _faults(f"{REQUESTS}[{number}]", request)]


def _faults(where: str, request: PipelineJobRequest) -> Iterator[Fault]:
    for field, uses in (
        ("robotApplications", request.robotApplications),
        ("simulationApplications", request.simulationApplications),
    ):
        if not uses:
            yield Fault(path=f"{where}.{field}", value="none", allowed="one: an episode needs a robot and a scenario")
            continue
        launch = uses[0].launchConfig
        for name, value, what in (
            ("packageName", launch.packageName, "folder in the bundle"),
            ("launchFile", launch.launchFile, "module in that folder"),
        ):
            if not value:
                path = f"{where}.{field}[0].launchConfig.{name}"
                yield Fault(path=path, value="none", allowed=f"the {what} to launch")
