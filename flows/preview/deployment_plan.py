"""`simyard plan` for a deployment: which version goes to which fleet, in which waves, and what stops it."""

from collections.abc import Collection, Iterator
from math import ceil

from flows.document.shipped_parts import unjudged_parts
from specs.bundle.launched_file import names_ros_launch
from specs.pipeline.section_requests import deployment_request, fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet
from tasks.deploy.fleet import launch_environment
from tasks.deploy.fleet.fleets import fleet_name
from tasks.deploy.fleet.robots import members
from tasks.deploy.rollout.resolved_request import bounds_for, timeout_s
from tasks.results.gate.shipped_builds import Shipment, shipment_lines, unjudged_lines
from tasks.ros.launch.robot_command import launch_sentence
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.resolve import FindVersion
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id


def deployment_lines(
    section: Deployment,
    store: Store,
    find: FindVersion,
    ships: Shipment,
    batch: BatchPlan | None,
    *,
    judged: bool,
    simulated_clock: Collection[str] = (),
) -> Iterator[str]:
    """Yields what a deployment does, without the name of its section.

    Args:
        section: The document's section.
        store: Where the fleet is.
        find: Finds versions.
        ships: What robots get.
        batch: The batch of the same document, which decides which version is deployed; None if there is none.
        judged: Whether a gate asks what the batch drove.
        simulated_clock: Launch files that make their nodes wait for a simulation's clock.
    """
    use, fleet = section.deploymentApplicationConfigs[0], section.fleet
    number = find("robot-application", use.application, use.applicationVersion).number
    newest = "version tested" if batch else f"newest version, {number}"
    version = newest if use.applicationVersion is None else f"version {use.applicationVersion}"
    agents = fleet.localAgents if isinstance(fleet, LocalFleet) else 0
    local = f" with {agents} agents on this machine" if isinstance(fleet, LocalFleet) else ""
    yield f"{use.application} ({version}) to fleet {fleet_reference(section)}{local}, bundle {ships.digest[:12]}"
    yield from _shipped_lines(section, ships, batch, judged=judged)
    yield from _launch_lines(section, batch, simulated_clock)
    robots = [] if agents else members(store, fleet_name(fleet_reference(section)))
    yield from _tag_lines({*(section.tags or {}), *(key for robot in robots for key in robot.tags)})
    yield from _rules(section, store, str(number), agents or len(robots))


def _shipped_lines(section: Deployment, ships: Shipment, batch: BatchPlan | None, *, judged: bool) -> Iterator[str]:
    if judged:
        yield from (line for line in shipment_lines(ships) if ships.builds or ships.digest[:12] not in line)
    elif batch:
        yield from unjudged_parts(section, ships, batch)
    else:
        yield from unjudged_lines(ships, ())


def _launch_lines(section: Deployment, batch: BatchPlan | None, simulated_clock: Collection[str]) -> Iterator[str]:
    launch = section.deploymentApplicationConfigs[0].launchConfig
    package, name = launch.packageName, launch.launchFile
    driven = [(each.robot.package, each.robot.launch_file) for each in batch.templates] if batch else []
    if driven:
        shown = ", ".join(dict.fromkeys("/".join(each) for each in driven))
        yield f"robots launch {package}/{name}; episodes drive {shown}"
    if not names_ros_launch(name):
        return
    yield f"robots run {launch_sentence(package, name)}"
    if other := [file for _, file in dict.fromkeys(driven) if names_ros_launch(file) and file != name]:
        yield f"robots launch another launch file than episodes: {', '.join(other)} was tested, {name} was not"
    if name in simulated_clock:
        yield f"{name} sets use_sim_time: on a robot, where nothing sends /clock, its nodes wait for ever"


def _tag_lines(keys: Collection[str]) -> Iterator[str]:
    if keys:
        names = ", ".join(f"{launch_environment.TAG_PREFIX}{key}" for key in sorted(keys))
        yield f"robots get tags as variables, which no episode has: {names}"


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
