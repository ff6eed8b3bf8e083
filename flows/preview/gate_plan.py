"""`simyard plan` for a gate and a deployment: what each rule needs, what is compared, and which version goes where.

A gate judges episodes, and pairs of episodes with another version; a deployment goes to a fleet in waves.
"""

import math
import shlex
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import ceil

from flows.pipeline.references import unjudged_parts
from flows.pipeline.tested_batch import candidates
from specs.launched_file import names_ros_launch
from specs.pipeline.gate_section import Gate, NoWorseThan
from specs.pipeline.section_requests import deployment_request, fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet
from tasks.deploy.fleet import launch_environment
from tasks.deploy.fleet.fleet_registry import fleet_name, members
from tasks.deploy.rollout.resolved_request import bounds_for, interpreter_notes, timeout_s
from tasks.results.gate.gate_verdict import GATE_RULES
from tasks.results.gate.rules.rule import PlannedEpisodes
from tasks.results.gate.shipped_builds import Shipment, shipment_lines, unjudged_lines
from tasks.ros.launch.robot_command import launch_sentence
from tasks.simulate.batch.batch_record import KIND, plan_of
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.plan.plan_batch import FindVersion
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import is_terminal, records
from tasks.storage.store_url import store_id

_Conditions = tuple[str, ...]


@dataclass(frozen=True)
class GateBasis:
    """What a gate is going to judge by.

    Attributes:
        episodes: Of the tested version; of all versions where none is compared with another.
        pairs: Episodes that the tested version and the other one drive both.
        no_baseline: Why there is nothing to compare with, where that is certain beforehand; else empty.
        searched: How many episodes the document's search may simulate; 0 without one.
    """

    episodes: int
    pairs: int
    no_baseline: str = ""
    searched: int = 0


def gate_basis(plan: BatchPlan, rule: NoWorseThan | None, baseline: str, store: Store) -> GateBasis:
    """Returns what a gate is going to judge a batch by.

    Args:
        plan: The batch.
        rule: The gate's comparison, if it has one.
        baseline: Digest of the version to compare with; empty if the batch tests several applications.
        store: Where other batches are.
    """
    everything = _episodes(plan, _templates(plan, frozenset(template.robot.digest for template in plan.templates)))
    if rule is None:
        return GateBasis(everything, everything)
    names = sorted({template.robot.name for template in plan.templates})
    meant = candidates(plan, baseline)
    if len(names) != 1:
        return GateBasis(everything, 0, f"the batch tests several applications ({', '.join(names)})")
    if len(meant) != 1:
        return GateBasis(everything, 0, f"the batch tests several versions besides version {rule.applicationVersion}")
    tested = _templates(plan, meant)
    episodes = _episodes(plan, tested)
    other = _templates(plan, frozenset({baseline}))
    if other:
        return GateBasis(episodes, _common(plan, tested, other))
    if _may_be_there(plan, baseline, store):
        return GateBasis(episodes, episodes)
    return GateBasis(episodes, 0, "no batch that Completed drove that version on any of these seeds")


def _templates(plan: BatchPlan, digests: frozenset[str]) -> list[JobTemplate]:
    return [template for template in plan.templates if template.robot.digest in digests]


def _episodes(plan: BatchPlan, templates: list[JobTemplate]) -> int:
    return sum(len(plan.worlds_of(template)) for template in templates) * _variants(plan)


def _common(plan: BatchPlan, tested: list[JobTemplate], other: list[JobTemplate]) -> int:
    ours, theirs = (Counter(_conditions(plan, templates)) for templates in (tested, other))
    return (ours & theirs).total() * _variants(plan)


def _variants(plan: BatchPlan) -> int:
    """Returns how many episodes there are of each request and world."""
    return len(plan.seeds) * plan.sharing * math.prod(map(len, plan.sweep.values()))


def _conditions(plan: BatchPlan, templates: list[JobTemplate]) -> list[_Conditions]:
    """Returns what is asked of the robot in each world of each request, as ``pairs`` pairs episodes."""
    return [
        (
            world,
            scenario.digest,
            scenario.package,
            scenario.launched,
            str(template.duration_s),
            str(template.seed),
            *own,
        )
        for template in templates
        for own in [
            [f"{name}={value}" for name, value in sorted(template.environment.items()) if name not in plan.sweep]
        ]
        for scenario in [template.scenario]
        for world in plan.worlds_of(template)
    ]


def _may_be_there(plan: BatchPlan, baseline: str, store: Store) -> bool:
    """Returns whether a batch drove the version on one of the seeds, or may yet; only its rows say on which worlds."""
    for record in records(store, KIND):
        if record.status == "Completed" or not is_terminal(record):
            theirs = plan_of(record)
            if set(theirs.seeds_used()) & set(plan.seeds_used()) and _templates(theirs, frozenset({baseline})):
                return True
    return False


_INDENT = " " * 18


def gate_lines(
    gate: Gate,
    judged: GateBasis,
    audited: int,
    programs: int = 1,
    *,
    worlds: int = 1,
    lanes: int = 0,
    pairs: bool = False,
    icc: float | None = None,
) -> Iterator[str]:
    """Yields lines for a person: each rule, and what it needs if episodes come out in some ways.

    Args:
        gate: The document's section.
        judged: What it is going to judge by.
        audited: How many of the batch's episodes are driven again on C MuJoCo.
        programs: How many compiled programs the batch has; only of one its episodes can be shuffled, to end it early.
        worlds: In how many worlds the episodes are.
        pairs: Whether two programs are the versions that the gate compares: they take turns on shuffled episodes.
        lanes: Episodes of a chunk, after each of which the gate is asked if it may end the batch early.
        icc: How alike episodes of one world were in earlier batches; None where nothing says that.
    """
    any_look = bool(gate.stopEarly) and (programs == 1 or pairs)
    looks = _looks(judged.episodes, lanes) if any_look and judged.episodes else ()
    planned = PlannedEpisodes(
        judged.episodes, judged.pairs, audited, judged.no_baseline, worlds, looks, icc, judged.searched
    )
    lines = [line for rule in GATE_RULES for _, asked in rule.asked(gate) for line in rule.plan(asked, planned)]
    if any_look:
        lines.append(f"may end the batch early, after any chunk{' of both versions' if pairs else ''}")
    elif gate.stopEarly:
        lines.append(f"runs the batch to its end: its {programs} programs cannot be shuffled into common chunks")
    for number, line in enumerate(lines):
        yield f"{'gate':<18}{line}" if number == 0 else f"{_INDENT}{line}"


def _looks(episodes: int, lanes: int) -> tuple[int, ...]:
    from tasks.results.statistics.interim_analyses import looks_of  # noqa: PLC0415 - arrays, which most commands do without

    return looks_of(episodes, lanes or episodes)


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
    found = find("robot-application", use.application, use.applicationVersion)
    number = found.number
    newest = "version tested" if batch else f"newest version, {number}"
    version = newest if use.applicationVersion is None else f"version {use.applicationVersion}"
    agents = fleet.localAgents if isinstance(fleet, LocalFleet) else 0
    local = f" with {agents} agents on this machine" if isinstance(fleet, LocalFleet) else ""
    yield f"{use.application} ({version}) to fleet {fleet_reference(section)}{local}, bundle {ships.digest[:12]}"
    yield from _shipped_lines(section, ships, batch, judged=judged)
    yield from _launch_lines(section, batch, simulated_clock)
    if not agents:
        yield from interpreter_notes(store, use.launchConfig, found)
    robots = [] if agents else members(store, fleet_name(fleet_reference(section)))
    yield from _tag_lines({*(section.tags or {}), *(key for robot in robots for key in robot.tags)})
    yield from _rules(section, store, str(number), agents or len(robots))


def _shipped_lines(section: Deployment, ships: Shipment, batch: BatchPlan | None, *, judged: bool) -> Iterator[str]:
    if judged:
        yield from (line for line in shipment_lines(ships) if ships.builds or ships.digest[:12] not in line)
    elif batch:
        yield from unjudged_parts(section, ships, batch)
    else:
        yield "no episode of this document drives the version, and no gate asks"
        yield from unjudged_lines(ships, ())


def _launch_lines(section: Deployment, batch: BatchPlan | None, simulated_clock: Collection[str]) -> Iterator[str]:
    launch = section.deploymentApplicationConfigs[0].launchConfig
    package, name = launch.packageName, launch.launchFile
    robots = [each.robot for each in batch.templates] if batch else []
    if robots:
        commands = (shlex.join(each.command or ()) or f"{each.package}/{each.launch_file}" for each in robots)
        shown = ", ".join(dict.fromkeys(commands))
        yield f"robots launch {package}/{name}; episodes drive {shown}"
    if not names_ros_launch(name):
        return
    yield f"robots run {launch_sentence(package, name)}"
    driven = dict.fromkeys(each.launch_file for each in robots)
    if other := [file for file in driven if names_ros_launch(file) and file != name]:
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
