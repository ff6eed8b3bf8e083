"""`simyard plan` for a deployment: which version goes to which fleet, in which waves, and what stops it."""

from collections.abc import Iterator
from math import ceil

from specs.pipeline.section_requests import deployment_request, fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet
from tasks.deploy.fleet.fleets import fleet_name
from tasks.deploy.fleet.robots import members
from tasks.deploy.rollout.resolved_request import bounds_for, timeout_s
from tasks.simulate.plan.resolve import FindVersion
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id


def deployment_lines(
    section: Deployment, store: Store, find: FindVersion, digest: str, *, tested: bool
) -> Iterator[str]:
    """Yields what a deployment does, without the name of its section.

    Args:
        section: The document's section.
        store: Where the fleet is.
        find: Finds versions.
        digest: Of the bundle that robots get.
        tested: Whether a batch of the same document decides which version is deployed.
    """
    use, fleet = section.deploymentApplicationConfigs[0], section.fleet
    number = find("robot-application", use.application, use.applicationVersion).number
    newest = "version tested" if tested else f"newest version, {number}"
    version = newest if use.applicationVersion is None else f"version {use.applicationVersion}"
    agents = fleet.localAgents if isinstance(fleet, LocalFleet) else 0
    local = f" with {agents} agents on this machine" if isinstance(fleet, LocalFleet) else ""
    yield f"{use.application} ({version}) to fleet {fleet_reference(section)}{local}, bundle {digest[:12]}"
    yield from _rules(section, store, str(number), agents or len(members(store, fleet_name(fleet_reference(section)))))


def _rules(section: Deployment, store: Store, version: str, robots: int) -> Iterator[str]:
    request = deployment_request(section, store_id=store_id(store), version=version, token="plan")  # noqa: S106
    bounds, rules = bounds_for(robots, request), section.rollOut
    first = min(rules.canaryRobots, robots)
    waves = ceil(first / bounds.at_once) + ceil((robots - first) / bounds.at_once)
    canaries = f", the first {first} of them canaries" if first else ""
    yield f"{robots} robots{canaries}, at most {bounds.at_once} at once: at least {waves} waves"
    least = f" once {rules.leastExecutedRobots} have ended" if rules.leastExecutedRobots else ""
    alone = ", one of a canary at once" if first else ""
    failures = f"failures that stop it: {bounds.failures}{least}{alone}"
    yield f"{failures}; a robot has {timeout_s(request):,} s to answer and to finish"
