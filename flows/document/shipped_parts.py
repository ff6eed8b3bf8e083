"""What a document ships: its builds and variables, held against what its batch drives, before anything runs."""

from collections.abc import Collection, Iterator, Mapping

from specs.errors import DocumentError
from specs.pipeline.simulation_section import Deployment
from specs.robomaker.bundle import Version
from tasks.results.gate.shipped_builds import Shipment, build_faults, shipment_of, unjudged_lines
from tasks.results.gate.shipped_variables import Driven, difference_faults, differing_names
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
    ships = shipment_of(section, version)
    faults = [
        *build_faults(version, section.untestedBuilds or {}, driven),
        *difference_faults(_given(section), _driven(ships, plan, driven), section.untestedVariables or {}),
    ]
    if faults:
        raise DocumentError(faults)
    return ships


def unjudged_parts(section: Deployment, ships: Shipment, plan: BatchPlan) -> Iterator[str]:
    """Yields what a section ships without a gate, and what of it the document's batch does not drive, for a person.

    Args:
        section: The document's section.
        ships: What it ships.
        plan: The document's batch.
    """
    driven = {template.robot.digest for template in plan.templates}
    yield from unjudged_lines(ships, driven)
    for name in differing_names(_given(section), _driven(ships, plan, driven)):
        yield f"variable {name}: not as simulated, and no gate asks"


def _given(section: Deployment) -> Mapping[str, str]:
    return section.deploymentApplicationConfigs[0].launchConfig.environmentVariables or {}


def _driven(ships: Shipment, plan: BatchPlan, driven: Collection[str]) -> list[list[Driven]]:
    """Returns what the episodes of each build that ships had."""
    digests = dict.fromkeys([ships.digest, *ships.digests().values()])
    return [_had(plan, digest) for digest in digests if digest in driven]


def _had(plan: BatchPlan, digest: str) -> list[Driven]:
    """Returns the variables that the episodes of a bundle have; not the folders of their data, which robots lack."""
    own = [template.environment for template in plan.templates if template.robot.digest == digest]
    texts = [{name: value for name, value in each.items() if not value.startswith(DATA_PREFIX)} for each in own]
    return [{**{name: (value,) for name, value in each.items()}, **plan.sweep} for each in texts]
