"""Deployment jobs, fleets and robots in RoboMaker's words."""

import time

from pydantic import ValidationError

from specs.arn import arn, store_id_of
from specs.errors import DocumentError, ObjectStrange
from specs.robomaker.deployment import (
    CreateDeploymentJobRequest,
    DeploymentJob,
    DescribeDeploymentJobResponse,
    ProgressDetail,
    RobotDeployment,
)
from specs.robomaker.failure_codes import DeploymentJobErrorCode, told_code
from specs.robomaker.fleet import DescribeFleetResponse, DescribeRobotResponse, Fleet, Robot
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.robots import members, read_desired, read_reported, read_robot
from tasks.deploy.fleet.states import Desired, FleetRecord, RobotProgress, RobotRecord, progress_of
from tasks.deploy.rollout.observation import live_progress, recorded_progress
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.store_url import store_id

_KIND = "deployment-job"
_REASON_CHARACTERS = 1024


def describe_deployment_job(store: Store, job: str) -> DescribeDeploymentJobResponse:
    """Returns a deployment job and how far each of its robots is; ``job`` is its id.

    Raises:
        ResourceNotFound: No such job.
    """
    record = read(store, _KIND, job)
    request = CreateDeploymentJobRequest.model_validate(record.request)
    progress = recorded_progress(record) if is_terminal(record) else live_progress(store, record, time.time())
    summary = tuple(_robot_deployment(name, each, record.arn) for name, each in progress.items())
    # The fields that a list shows, and the robots and tags.
    return DescribeDeploymentJobResponse.model_validate(
        {**_job(record, request).model_dump(), "robotDeploymentSummary": summary, "tags": request.tags}
    )


def summarise_deployment_job(record: JobRecord) -> DeploymentJob:
    """Returns the job's line in ListDeploymentJobs."""
    return _job(record, CreateDeploymentJobRequest.model_validate(record.request))


def describe_fleet(store: Store, reference: str) -> DescribeFleetResponse:
    """Returns a fleet, its robots and its last deployment, by name or ARN.

    Raises:
        ResourceNotFound: No such fleet.
        DocumentError: The name is none.
    """
    fleet, _ = read_fleet(store, reference)
    identifier = store_id(store)
    return DescribeFleetResponse.model_validate(
        {
            **_fleet(store, fleet, identifier).model_dump(),
            "robots": tuple(_robot(store, robot, identifier) for robot in members(store, fleet.name)),
            "tags": fleet.tags or None,
        }
    )


def summarise_fleet(store: Store, fleet: FleetRecord) -> Fleet:
    """Returns a fleet's line in ListFleets."""
    return _fleet(store, fleet, store_id(store))


def describe_robot(store: Store, reference: str) -> DescribeRobotResponse:
    """Returns a robot and its last deployment, by name or ARN.

    Raises:
        ResourceNotFound: No such robot.
        DocumentError: The name is none.
    """
    record, _ = read_robot(store, reference)
    # The shapes spell Greengrass differently.
    document = _robot(store, record, store_id(store)).model_dump(exclude={"greenGrassGroupId"})
    own = {"greengrassGroupId": record.greengrass_group or None, "tags": record.tags or None}
    return DescribeRobotResponse.model_validate({**document, **own})


def summarise_robot(store: Store, robot: RobotRecord) -> Robot:
    """Returns a robot's line in ListRobots."""
    return _robot(store, robot, store_id(store))


def _job(record: JobRecord, request: CreateDeploymentJobRequest) -> DeploymentJob:
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


def _fleet(store: Store, fleet: FleetRecord, identifier: str) -> Fleet:
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
    except (DocumentError, ObjectStrange):  # it was never recorded, or a stranger wrote the one or the other
        return None


def _robot(store: Store, record: RobotRecord, identifier: str) -> Robot:
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
