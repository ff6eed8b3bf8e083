"""Which versions a document tests, and which one it compares them with; told without looking at any results."""

from specs.errors import ResourceNotFound
from specs.pipeline.gate_section import Gate
from specs.pipeline.simulation_section import SimulationBatch
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.resolve import FindVersion


def compared_digest(gate: Gate | None, batch: SimulationBatch, find: FindVersion) -> str:
    """Returns the digest of the version that a gate compares with; empty if it compares with none.

    Args:
        gate: The document's section.
        batch: The document's batch.
        find: Finds versions.

    Raises:
        ResourceNotFound: There is no such version.
    """
    rule = gate.noWorseThan if gate else None
    uses = [use.application for request in batch.createSimulationJobRequests for use in request.robotApplications or ()]
    if rule is None or len(set(uses)) != 1:
        return ""
    try:
        return find("robot-application", uses[0], rule.applicationVersion).digest
    except ResourceNotFound as exc:
        faults = [fault.model_copy(update={"path": "gate.noWorseThan.applicationVersion"}) for fault in exc.faults]
        raise ResourceNotFound(faults) from exc


def candidates(plan: BatchPlan, baseline: str) -> frozenset[str]:
    """Returns the digests of the robot applications that a batch tests, apart from the one to compare with.

    A batch that has only that one tests it against itself.
    """
    own = frozenset(template.robot.digest for template in plan.templates)
    return own - {baseline} or own
