"""What a document ships: its builds and variables, held against what its batch drives, before anything runs."""

from collections.abc import Collection

from specs.errors import DocumentError
from specs.pipeline.simulation_section import Deployment
from specs.robomaker.bundle import Version
from tasks.results.gate.shipped_builds import Shipment, build_faults, shipment_of
from tasks.results.gate.shipped_variables import Driven, difference_faults
from tasks.simulate.data.sources import DATA_PREFIX
from tasks.simulate.plan.batch_plan import BatchPlan


def judged_shipment(section: Deployment, version: Version, plan: BatchPlan, driven: Collection[str]) -> Shipment:
    """Returns what a section ships under a gate.

    Args:
        section: The document's section.
        version: What it deploys.
        plan: The batch that the gate judges.
        driven: SHA-256 of each robot application that the batch tests.

    Raises:
        DocumentError: A build or a variable is not what the batch drives, and the section does not say so; or it says
            so without need.
    """
    digests = [digest for digest in {version.digest: 0, **dict.fromkeys(version.digests.values())} if digest in driven]
    given = section.deploymentApplicationConfigs[0].launchConfig.environmentVariables or {}
    faults = [
        *build_faults(version, section.untestedBuilds or {}, driven),
        *difference_faults(given, [_had(plan, digest) for digest in digests], section.untestedVariables or {}),
    ]
    if faults:
        raise DocumentError(faults)
    return shipment_of(section, version)


def _had(plan: BatchPlan, digest: str) -> list[Driven]:
    """Returns the variables that the episodes of a bundle have; not the folders of their data, which robots lack."""
    own = [template.environment for template in plan.templates if template.robot.digest == digest]
    texts = [{name: value for name, value in each.items() if not value.startswith(DATA_PREFIX)} for each in own]
    return [{**{name: (value,) for name, value in each.items()}, **plan.sweep} for each in texts]
