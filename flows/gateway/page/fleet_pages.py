"""The pages of fleets, robots and deployments, and of the applications that are deployed or simulated.

A robot's page says what it shall run, what it runs, and what it said last.
"""

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import PurePosixPath

from flows.gateway.page.request_context import (
    PAGE_ROWS,
    RequestContext,
    address,
    at_once,
    job,
    known_jobs,
    missing,
    named,
    newest_jobs,
    newest_names,
    nothing_there,
    state,
    step_of,
    tag_rows,
    when,
)
from specs.errors import ResourceNotFound, StoreError, StoreUnreachable
from specs.job_kinds import JobKind
from specs.robomaker.bundle import Application, ApplicationKind, Version
from tasks.applications.versions import read_application
from tasks.deploy.fleet.fleet_registry import known_robot, read_desired, read_fleet, read_reported
from tasks.deploy.fleet.states import FleetRecord, RobotRecord
from tasks.deploy.fleet_descriptions import RobotNow, robot_cells, robots_now, view_deployment
from tasks.deploy.rollout.observation import recorded_progress, rollout_standing
from tasks.gateway.page.content import Cell, Facts, Page, Table
from tasks.storage.base.keys import applications_prefix
from tasks.storage.jobs.records import JobRecord, is_terminal

_KINDS: Mapping[str, ApplicationKind] = {"robot": "robot-application", "simulation": "simulation-application"}
_DEPLOYMENT: JobKind = "deployment-job"
_ROBOTS_LOOKED_AT = 5_000
_NOTE = "A robot reports when something changes, and not otherwise."
_COLUMNS = ("Robot", "Status", "Shall run", "Runs", "Step", "Last report", "Why not")


def applications_page(context: RequestContext) -> Page:
    """Returns the list of applications of both kinds."""
    tables = tuple(_applications_table(context, word, kind) for word, kind in _KINDS.items())
    return Page("Applications", blocks=tables)


def application_page(context: RequestContext, section: str, name: str) -> Page:
    """Returns the page of an application with its versions.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no application's, or there is no such section.
    """
    kind = _KINDS.get(section)
    if kind is None:
        raise nothing_there()
    context.require(kind, name)
    found = read_application(context.store, kind, name)
    if found is None or found.deleted:
        raise missing(kind, name)
    rows = tuple(
        (
            Cell(str(version.number)),
            Cell(version.digest, is_code=True),
            Cell(f"{version.size_bytes:,}", is_number=True),
            Cell(_origin(version)),
            when(version.created_at_s),
        )
        for version in reversed(found.versions)
    )
    table = Table("Versions", ("Version", "Bundle", "Bytes", "From", "Made"), rows, "No version yet.")
    sources = tuple(
        ("source", Cell(f"s3://{each.s3Bucket}/{each.s3Key}", small=str(each.architecture))) for each in found.sources
    )
    facts = Facts("The application", (*sources, *context.arn_rows(context.arn(kind, name))))
    title = "Robot application" if kind == "robot-application" else "Simulation application"
    return Page(name, title, trail=(("Applications", "/applications"),), blocks=(table, facts))


def _applications_table(context: RequestContext, word: str, kind: ApplicationKind) -> Table:
    def name_of(key: str) -> str:
        name = PurePosixPath(key).stem
        return name if context.may_read(context.arn(kind, name)) else ""

    shown, steps = step_of(context, newest_names(context, applications_prefix(kind), name_of), "/applications")
    found = at_once(partial(_application_table, context, kind), shown)
    rows = tuple(
        (
            Cell(each.name, address(kind, each.name)),
            Cell(each.numbers),
            when(each.versions[-1].created_at_s if each.versions else None),
        )
        for each in found
        if each
    )
    columns = ("Application", "Versions", "Newest from")
    return Table(f"{word.capitalize()} applications", columns, rows, "None yet.", steps=steps)


def _application_table(context: RequestContext, kind: ApplicationKind, name: str) -> Application | None:
    try:
        found = read_application(context.store, kind, name)
    except StoreUnreachable:
        raise
    except StoreError:  # it is damaged
        return None
    return None if found is None or found.deleted else found


def _origin(version: Version) -> str:
    if version.builds:
        return ", ".join(build.architecture for build in version.builds)
    return "Simyard" if version.shipped else "a document" if version.brought else "a folder"


def fleets_table(context: RequestContext, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the fleets; with an address for all of them, no more than the first."""
    names = newest_names(context, "fleets", lambda key: _fleet_name(context, key))
    shown, steps = step_of(context, names, "/fleets", most)
    fleets = at_once(partial(_fleet, context), shown)
    rows = tuple(
        (
            Cell(fleet.name, address("deployment-fleet", fleet.name)),
            Cell(fleet.deployment, address(_DEPLOYMENT, fleet.deployment) if fleet.deployment else ""),
            when(fleet.created_at_s),
        )
        for fleet in fleets
        if fleet
    )
    empty = "No fleet yet: simyard fleet create, or CreateFleet, makes one."
    columns = ("Fleet", "Last deployment", "Made")
    return Table("Fleets", columns, rows, empty, href if steps else "", None if href else steps)


def fleets_page(context: RequestContext) -> Page:
    """Returns the list of fleets."""
    return Page("Fleets", blocks=(fleets_table(context),))


def fleet_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a fleet, with how each of its robots is.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no fleet's.
    """
    context.require("deployment-fleet", name)
    fleet = read_fleet(context.store, name)
    known = _robot_names(context)
    records = at_once(partial(_robot, context), known[:_ROBOTS_LOOKED_AT])
    members = sorted(record.name for record in records if record and record.fleet == fleet.name)
    left_out = len(known) - _ROBOTS_LOOKED_AT
    cut = f" The {_ROBOTS_LOOKED_AT:,} robots that were changed last are looked at; {left_out:,} are not."
    here = address("deployment-fleet", fleet.name)
    shown, steps = step_of(context, members, here)
    note = f"{_NOTE}{cut if left_out > 0 else ''}"
    table = Table("Robots", _COLUMNS, _robot_rows(context, shown), "No robot is in it.", steps=steps, note=note)
    last = [known_jobs(context, _DEPLOYMENT, [fleet.deployment])] if fleet.deployment else []
    rows = (
        ("robots", Cell(f"{len(members):,}")),
        ("made", when(fleet.created_at_s)),
        *(
            ("last deployment", Cell(each.id, address(_DEPLOYMENT, each.id), context.plain(_standing(each))))
            for found in last
            for each in found
        ),
        *context.arn_rows(context.arn("deployment-fleet", fleet.name)),
        *tag_rows(context, "deployment-fleet", name, fleet.tags),
    )
    going = any(not is_terminal(each) for found in last for each in found)
    return Page(
        fleet.name, "Fleet", trail=(("Fleets", "/fleets"),), blocks=(table, Facts("The fleet", rows)), is_going=going
    )


def _standing(record: JobRecord) -> str:
    """Returns a deployment's status, and which robots ran which version when its record was written last."""
    seen = recorded_progress(record)
    return f"{record.status}: {rollout_standing(record, seen)[0]}" if seen else record.status


def robots_page(context: RequestContext) -> Page:
    """Returns the list of robots."""
    shown, steps = step_of(context, _robot_names(context), "/robots")
    empty = "No robot yet: simyard fleet robot, or CreateRobot, makes one."
    return Page(
        "Robots", blocks=(Table("Robots", _COLUMNS, _robot_rows(context, shown), empty, steps=steps, note=_NOTE),)
    )


def robot_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a robot.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no robot's.
    """
    context.require("robot", name)
    record = known_robot(context.store, name)
    if record is None:
        raise missing("robot", name)
    now = next(iter(robots_now(context.store, [name])), None)
    status = now.status if now else "Registered" if record.fleet else "Available"
    who = (
        ("fleet", Cell(record.fleet, address("deployment-fleet", record.fleet)))
        if record.fleet
        else ("fleet", Cell("none")),
        ("architecture", Cell(record.architecture)),
        ("made", when(record.created_at_s)),
        *context.arn_rows(context.arn("robot", name)),
        *tag_rows(context, "robot", name, record.tags),
    )
    trail = (("Robots", "/robots"),)
    blocks = (_desired(context, name), _reported(context, name, now), Facts("The robot", who))
    why = context.plain(now.why) if now else ""
    going = status in {"Deploying", "PendingNewDeployment"}
    return Page(name, "Robot", status, why, trail, blocks=blocks, is_going=going)


def deployments_table(context: RequestContext, most: int = PAGE_ROWS, href: str = "") -> Table:
    """Returns the newest deployments; with an address for all of them, no more than the first."""
    shown, steps = step_of(context, newest_jobs(context, _DEPLOYMENT), "/deployments", most)
    rows = tuple(
        (
            Cell(record.id, address(_DEPLOYMENT, record.id)),
            state(record.status),
            named(record.request.get("fleet"), "deployment-fleet"),
            _application(record),
            when(record.updated_at_s),
            Cell(context.plain(record.failure_reason)),
        )
        for record in known_jobs(context, _DEPLOYMENT, shown)
    )
    columns = ("Deployment", "Status", "Fleet", "Application", "Changed", "Why not")
    empty = "No deployment yet: simyard fleet deploy, or CreateDeploymentJob, begins one."
    return Table("Deployments", columns, rows, empty, href if steps else "", None if href else steps)


def deployments_page(context: RequestContext) -> Page:
    """Returns the list of deployments."""
    return Page("Deployments", blocks=(deployments_table(context),))


def deployment_page(context: RequestContext, name: str) -> Page:
    """Returns the page of a deployment, with how far each of its robots is.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no deployment's.
    """
    record = job(context, _DEPLOYMENT, name)
    view = view_deployment(context.store, name)
    described = view.job
    shown, steps = step_of(context, described.robotDeploymentSummary or (), address(_DEPLOYMENT, name))
    rows: list[tuple[Cell, ...]] = []
    for each in shown:
        robot, status, runs, step, percent, why = robot_cells(each, view.runs)
        done = Cell(step, small=percent)
        ended = when(each.deploymentFinishTime)
        row = (
            Cell(robot, address("robot", robot)),
            state(status),
            Cell(context.plain(runs)),
            done,
            ended,
            Cell(context.plain(why)),
        )
        rows.append(row)
    columns = ("Robot", "Status", "Runs", "Step", "Ended", "Why not")
    table = Table("Robots", columns, tuple(rows), "Not planned yet.", steps=steps)
    config = described.deploymentConfig
    facts = [
        ("robots", Cell(context.plain(view.standing))),
        ("fleet", named(record.request.get("fleet"), "deployment-fleet")),
        ("application", _application(record)),
        ("at once", Cell(f"{config.concurrentDeploymentPercentage} % of the fleet"))
        if config and config.concurrentDeploymentPercentage
        else None,
        ("signed", Cell(context.plain(str(record.detail["trust"])))) if "trust" in record.detail else None,
        ("begun", when(record.created_at_s)),
        ("changed", when(record.updated_at_s)),
        *context.arn_rows(record.arn),
        *tag_rows(context, _DEPLOYMENT, name, described.tags),
    ]
    blocks = (table, Facts("The deployment", tuple(row for row in facts if row)))
    why, trail = context.plain(view.why), (("Deployments", "/deployments"),)
    return Page(name, "Deployment job", record.status, why, trail, blocks=blocks, is_going=not is_terminal(record))


def _robot_rows(context: RequestContext, names: Iterable[str]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(at_once(partial(_robot_row, context), names))


def _robot_row(context: RequestContext, name: str) -> tuple[Cell, ...]:
    now = next(iter(robots_now(context.store, [name])), None)
    desired, _ = read_desired(context.store, name)
    reported = read_reported(context.store, name)
    record = _robot(context, name)
    idle = "Registered" if record and record.fleet else "Available"
    return (
        Cell(name, address("robot", name)),
        state(now.status if now else idle),
        Cell(f"{desired.application} {desired.version}" if desired else ""),
        Cell(now.runs if now else ""),
        Cell(reported.step if reported else ""),
        when(now.reported_s) if now and now.reported_s else Cell("never"),
        Cell(context.plain(now.why) if now else ""),
    )


def _desired(context: RequestContext, name: str) -> Facts:
    desired, _ = read_desired(context.store, name)
    if desired is None:
        return Facts("What it shall run", (("nothing", Cell("No deployment has asked it for anything.")),))
    rows = [
        (
            "version",
            Cell(f"{desired.application} {desired.version}", address("robot-application", desired.application)),
        ),
        ("bundle", Cell(desired.digest, is_code=True)),
        ("deployment", Cell(desired.deployment, address(_DEPLOYMENT, desired.deployment))),
        ("asked", when(desired.issued_at_s)),
        ("to be done within", Cell(f"{desired.timeout_s:,.0f} s")),
        ("may begin until", when(desired.expires_at_s)) if desired.expires_at_s else None,
        ("signed by", Cell(desired.signature.keyid, is_code=True)) if desired.signature else ("signed", Cell("no")),
    ]
    return Facts("What it shall run", tuple(row for row in rows if row))


def _reported(context: RequestContext, name: str, now: RobotNow | None) -> Facts:
    reported = read_reported(context.store, name)
    if reported is None:
        return Facts("What it reports", (("nothing", Cell("It has never reported.")),))
    rows = [
        ("runs", Cell(now.runs)) if now else ("runs", Cell(reported.running_digest, is_code=True)),
        ("last report", when(now.reported_s)) if now else None,
        ("status", state(reported.status)),
        ("step", Cell(reported.step)),
        ("downloaded", Cell(f"{reported.percent_done:.0f} %")) if reported.status == "Deploying" else None,
        ("begun", when(reported.started_at_s)),
        ("ended", when(reported.finished_at_s)) if reported.finished_at_s else None,
        ("failure", Cell(context.plain(f"{reported.failure_code}: {reported.failure_reason}")))
        if reported.failure_code
        else None,
    ]
    return Facts("What it reports", tuple(row for row in rows if row))


def _application(record: JobRecord) -> Cell:
    plan = record.detail.get("plan")
    if isinstance(plan, dict):
        name = str(plan.get("application", ""))
        return Cell(f"{name} {plan.get('version', '')}", address("robot-application", name))
    configs = record.request.get("deploymentApplicationConfigs")
    first = configs[0] if isinstance(configs, list) and configs else None
    return named(first.get("application"), "robot-application") if isinstance(first, dict) else Cell()


def _fleet_name(context: RequestContext, key: str) -> str:
    name = PurePosixPath(key).stem
    return name if context.may_read(context.arn("deployment-fleet", name)) else ""


def _fleet(context: RequestContext, name: str) -> FleetRecord | None:
    try:
        return read_fleet(context.store, name)
    except ResourceNotFound:  # it is being deleted
        return None
    except StoreUnreachable:
        raise
    except StoreError:  # it is damaged
        return None


def _robot_names(context: RequestContext) -> list[str]:
    def name_of(key: str) -> str:
        _, name, file = key.split("/", 2)
        return name if file == "record.json" and context.may_read(context.arn("robot", name)) else ""

    return newest_names(context, "robots", name_of)


def _robot(context: RequestContext, name: str) -> RobotRecord | None:
    try:
        return known_robot(context.store, name)
    except StoreUnreachable:
        raise
    except StoreError:  # it is damaged
        return None
