"""Deployment jobs, fleets and robots in RoboMaker's words: one, in pages oldest first, and as rows for a person."""

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from specs.arn import arn, parse_reference, reference_path, store_id_of
from specs.errors import DocumentError, ObjectCorrupt, ObjectNotFound
from specs.job_kinds import JobKind
from specs.robomaker.deployment import (
    CreateDeploymentJobRequest,
    DeploymentJob,
    DescribeDeploymentJobResponse,
    DescribeFleetResponse,
    DescribeRobotResponse,
    Fleet,
    ListDeploymentJobsRequest,
    ListDeploymentJobsResponse,
    ListFleetsRequest,
    ListFleetsResponse,
    ListRobotsRequest,
    ListRobotsResponse,
    ProgressDetail,
    Robot,
    RobotDeployment,
)
from specs.robomaker.failure_codes import DeploymentJobErrorCode, told_code
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from tasks.deploy.fleet.fleet_registry import (
    fleets,
    members,
    read_desired,
    read_fleet,
    read_reported,
    read_robot,
    robots,
)
from tasks.deploy.fleet.states import Desired, FleetRecord, RobotProgress, RobotRecord, progress_of
from tasks.deploy.rollout.observation import (
    NOTHING,
    VersionNames,
    live_progress,
    recorded_progress,
    rollout_standing,
)
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM, is_unsigned
from tasks.storage.base.keys import reported_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import IndexEntry, all_entries, index_page, place_of
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.store_url import store_id

_KIND: JobKind = "deployment-job"
_REASON_CHARACTERS = 1024
_FLEET, _ROBOT = "deployment-fleet", "robot"
_PLACE = (int, str)
_MOST = 200
ROBOT_COLUMNS = ("robot", "status", "runs", "step", "done", "why")


@dataclass(frozen=True)
class RobotNow:
    """A robot that was asked for something, as it is now.

    Attributes:
        deployment: Id of the job that asked it last.
        status: As RoboMaker names it.
        why: What went wrong, or empty.
        runs: Such as ``courier 3``, or ``nothing``, as it reported last.
        reported_s: When that was, by the store's clock; None if it never did.
    """

    name: str
    deployment: str
    status: str
    why: str
    runs: str
    reported_s: float | None


def robots_now(store: Store, names: Iterable[str]) -> list[RobotNow]:
    """Returns how those of the named robots are that were ever asked for something, in the same order."""
    versions, found = VersionNames(store), list[RobotNow]()
    for name in names:
        desired, _ = read_desired(store, name)
        if desired is None:
            continue
        reported = read_reported(store, name)
        now = progress_of(desired, reported, now_s=time.time())
        runs = versions.of(reported, desired) if reported else NOTHING
        found.append(RobotNow(name, desired.deployment, now.status, now.failure_reason, runs, _reported_s(store, name)))
    return found


def _reported_s(store: Store, robot: str) -> float | None:
    try:
        return store.entry(reported_key(robot)).written_s
    except ObjectNotFound:
        return None


def describe_deployment_job(store: Store, job: str) -> DescribeDeploymentJobResponse:
    """Returns a deployment job and how far each of its robots is; ``job`` is its id.

    Raises:
        ResourceNotFound: No such job.
    """
    return view_deployment(store, job).job


@dataclass(frozen=True)
class DeploymentView:
    """A deployment as a person sees it.

    Attributes:
        job: RoboMaker's answer.
        record: The job's.
        standing: Which robots run which version, who went back, and who was never asked.
        why: What stopped it, with RoboMaker's code; or empty.
        runs: What each robot ran by the report that was read; empty where none was looked up.
    """

    job: DescribeDeploymentJobResponse
    record: JobRecord
    standing: str
    why: str
    runs: Mapping[str, str]


def view_deployment(store: Store, job: str) -> DeploymentView:
    """Returns a deployment job, its robots, and what they run; ``job`` is its id.

    Raises:
        ResourceNotFound: No such job.
    """
    record = read(store, _KIND, job)
    progress = recorded_progress(record) if is_terminal(record) else live_progress(store, record, time.time())
    summary = tuple(_robot_deployment(name, each, record.arn) for name, each in progress.items())
    # The fields that a list shows, and the robots and tags.
    told = DescribeDeploymentJobResponse.model_validate(
        {
            **summarise_deployment_job(record).model_dump(),
            "robotDeploymentSummary": summary,
            "tags": record.request.get("tags"),
        }
    )
    runs = {name: each.runs for name, each in progress.items()}
    return DeploymentView(told, record, *rollout_standing(record, progress), runs)


def describe_fleet(store: Store, reference: str) -> DescribeFleetResponse:
    """Returns a fleet, its robots and its last deployment, by name or ARN.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: The name is none.
    """
    fleet = read_fleet(store, reference)
    identifier = store_id(store)
    return DescribeFleetResponse.model_validate(
        {
            **summarise_fleet(store, fleet, identifier).model_dump(),
            "robots": tuple(summarise_robot(store, robot, identifier) for robot in members(store, fleet.name)),
            "tags": fleet.tags or None,
        }
    )


def describe_robot(store: Store, reference: str) -> DescribeRobotResponse:
    """Returns a robot and its last deployment, by name or ARN.

    Raises:
        ResourceNotFound: No such robot.
        DocumentError: The name is none.
    """
    record = read_robot(store, reference)
    # The shapes spell Greengrass differently.
    document = summarise_robot(store, record, store_id(store)).model_dump(exclude={"greenGrassGroupId"})
    own = {"greengrassGroupId": record.greengrass_group or None, "tags": record.tags or None}
    return DescribeRobotResponse.model_validate({**document, **own})


def summarise_deployment_job(record: JobRecord) -> DeploymentJob:
    """Returns the job's line in ListDeploymentJobs."""
    request = CreateDeploymentJobRequest.model_validate(record.request)
    return DeploymentJob.model_validate(
        {
            "arn": record.arn,
            "fleet": request.fleet,
            "status": record.status,
            "deploymentApplicationConfigs": request.deploymentApplicationConfigs,
            "deploymentConfig": request.deploymentConfig,
            "failureReason": record.failure_reason[:_REASON_CHARACTERS] or None,
            "failureCode": told_code(record.failure_code, DeploymentJobErrorCode) if record.failure_code else None,
            "createdAt": record.created_at_s,
        }
    )


def _robot_deployment(name: str, progress: RobotProgress, job: str) -> RobotDeployment:
    # docs/reference/robomaker.md, section 8: the only step with a percentage
    loading = progress.step == "DownloadingExtracting"
    percent = progress.percent_done if loading else None
    detail = ProgressDetail(currentProgress=progress.step, percentDone=percent, targetResource=job)
    return RobotDeployment(
        arn=arn("robot", store_id_of(job), name),
        deploymentStartTime=progress.started_at_s or None,
        deploymentFinishTime=progress.finished_at_s or None,
        status=progress.status,
        progressDetail=detail if progress.step else None,
        failureReason=" ".join(progress.failure_reason.split())[:_REASON_CHARACTERS] or None,  # as a robot wrote it
        failureCode=progress.failure_code,
    )


def summarise_fleet(store: Store, fleet: FleetRecord, identifier: str) -> Fleet:
    """Returns a fleet's line in ListFleets; the identifier is the store's."""
    own = {"name": fleet.name, "arn": arn("deployment-fleet", identifier, fleet.name), "createdAt": fleet.created_at_s}
    last = _last_job(store, fleet)
    if last is None:
        return Fleet.model_validate(own)
    said = {
        "lastDeploymentStatus": last.status,
        "lastDeploymentJob": last.arn,
        "lastDeploymentTime": last.created_at_s,
    }
    try:
        return Fleet.model_validate({**own, **said})
    except ValidationError:  # a stranger's record of a job is no fault of the fleet, nor of the others in its list
        return Fleet.model_validate(own)


def _last_job(store: Store, fleet: FleetRecord) -> JobRecord | None:
    try:
        return read(store, _KIND, fleet.deployment) if fleet.deployment else None
    except (DocumentError, ObjectCorrupt):  # it was never recorded, or a stranger wrote the one or the other
        return None


def summarise_robot(store: Store, record: RobotRecord, identifier: str) -> Robot:
    """Returns a robot's line in ListRobots; the identifier is the store's."""
    desired, _ = read_desired(store, record.name)
    return Robot(
        arn=arn("robot", identifier, record.name),
        name=record.name,
        fleetArn=arn("deployment-fleet", identifier, record.fleet) if record.fleet else None,
        status=_progress(store, record, desired).status,
        createdAt=record.created_at_s,
        greenGrassGroupId=record.greengrass_group or None,
        architecture=record.architecture,
        lastDeploymentJob=arn(_KIND, identifier, desired.deployment) if desired else None,
        lastDeploymentTime=desired.issued_at_s if desired else None,
    )


def _progress(store: Store, record: RobotRecord, desired: Desired | None) -> RobotProgress:
    if desired is None:
        return RobotProgress(status="Registered" if record.fleet else "Available")
    return progress_of(desired, read_reported(store, record.name), now_s=time.time())


def deployment_entry(_store: Store, record: JobRecord) -> IndexEntry:
    """Returns the index entry of a deployment job."""
    job = summarise_deployment_job(record)
    values = {"status": (record.status,), "fleetName": (reference_path(str(job.fleet)),)}
    return IndexEntry(
        place_of(record.created_at_s, record.id), values, job.model_dump(mode="json", exclude_none=True), {}
    )


def list_deployment_jobs(store: Store) -> Iterator[DeploymentJob]:
    """Yields all deployment jobs."""
    return (DeploymentJob.model_validate(entry.summary) for entry in all_entries(store, _KIND, deployment_entry))


def list_deployment_jobs_page(store: Store, request: ListDeploymentJobsRequest) -> ListDeploymentJobsResponse:
    """Returns one page of the deployment jobs; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in ("status", "fleetName")}
    found, token = index_page(store, _KIND, deployment_entry, request, most=_MOST, filters=filters)
    return ListDeploymentJobsResponse(
        deploymentJobs=tuple(DeploymentJob.model_validate(each) for each in found), nextToken=token
    )


def list_fleets(store: Store) -> Iterator[Fleet]:
    """Yields all fleets."""
    return (summarise_fleet(store, fleet, store_id(store)) for fleet in fleets(store))


def list_fleets_page(store: Store, request: ListFleetsRequest) -> ListFleetsResponse:
    """Returns one page of the fleets; the filter is ``name``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    names = wanted_values(request, ("name",)).get("name")
    size, after = page_size(request, _MOST), place_after(request, _FLEET, _PLACE)
    wanted = (each for each in fleets(store) if names is None or each.name in names)
    later = ((place_of(each.created_at_s, each.name), each) for each in wanted)
    found, token = page_of((each for each in later if after is None or each[0] > after), size, _FLEET)
    identifier = store_id(store)
    shown = tuple(summarise_fleet(store, each, identifier) for each in found)
    return ListFleetsResponse(fleetDetails=shown, nextToken=token)


def list_robots(store: Store) -> Iterator[Robot]:
    """Yields all robots."""
    return (summarise_robot(store, robot, store_id(store)) for robot in robots(store))


def list_robots_page(store: Store, request: ListRobotsRequest) -> ListRobotsResponse:
    """Returns one page of the robots; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    wanted = wanted_values(request, ("status", "fleetName"))
    size, after = page_size(request, _MOST), place_after(request, _ROBOT, _PLACE)
    found, token = page_of(_robot_documents(store, after, wanted.get("fleetName"), wanted.get("status")), size, _ROBOT)
    return ListRobotsResponse(robots=found, nextToken=token)


def _robot_documents(
    store: Store, after: Place | None, in_fleets: frozenset[str] | None, statuses: frozenset[str] | None
) -> Iterator[tuple[Place, Robot]]:
    """Yields the robots after a place; only of those that may be wanted is read what was asked of them, and came."""
    identifier = store_id(store)
    for record in robots(store):
        place = place_of(record.created_at_s, record.name)
        if (after is None or place > after) and (in_fleets is None or record.fleet in in_fleets):
            robot = summarise_robot(store, record, identifier)
            if statuses is None or robot.status in statuses:
                yield place, robot


def robot_cells(robot: RobotDeployment, runs: Mapping[str, str]) -> tuple[str, str, str, str, str, str]:
    """Returns what there is to say of a robot, in the order of `ROBOT_COLUMNS`; ``runs`` says what each one runs."""
    detail = robot.progressDetail
    percent, name = detail.percentDone if detail else None, parse_reference(robot.arn or "").path
    return (
        name,
        robot.status or "",
        runs.get(name, ""),
        (detail.currentProgress or "") if detail else "",
        f"{percent:.0f} %" if percent is not None else "",
        ": ".join(filter(None, (robot.failureCode, robot.failureReason))),
    )


def robot_rows(view: DeploymentView) -> list[dict[str, str]]:
    """Returns a row a robot, by column."""
    robots = view.job.robotDeploymentSummary or ()
    return [dict(zip(ROBOT_COLUMNS, robot_cells(robot, view.runs), strict=True)) for robot in robots]


def deployment_sentence(view: DeploymentView) -> str:
    """Returns how a deployment went, in a sentence, with the alarm if it is unsigned."""
    sentence = "; ".join(filter(None, (f"{view.job.status}: {view.standing}", view.why)))
    return f"{sentence}. {UNSIGNED_ALARM}" if is_unsigned(view.record) else sentence
