"""Pages of ListDeploymentJobs, ListFleets and ListRobots, oldest first."""

from collections.abc import Iterator

from specs.arn import reference_path
from specs.job_kinds import JobKind
from specs.robomaker.deployment import DeploymentJob, ListDeploymentJobsRequest, ListDeploymentJobsResponse
from specs.robomaker.fleet import (
    Fleet,
    ListFleetsRequest,
    ListFleetsResponse,
    ListRobotsRequest,
    ListRobotsResponse,
    Robot,
)
from specs.robomaker.list_pages import Place, page_of, page_size, place_after, wanted_values
from tasks.deploy.answers.describe import summarise_deployment_job, summarise_fleet, summarise_robot
from tasks.deploy.fleet.fleets import fleets
from tasks.deploy.fleet.robots import robots
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.line_page import all_lines, line_page
from tasks.storage.jobs.lines.marks import mark_of
from tasks.storage.jobs.lines.segments import Line
from tasks.storage.jobs.records import JobRecord

_KIND: JobKind = "deployment-job"
_FLEET, _ROBOT = "deployment-fleet", "robot"
_PLACE = (int, str)
_MOST = 200


def deployment_line(_store: Store, record: JobRecord) -> Line:
    """Returns the line of a deployment job."""
    job = summarise_deployment_job(record)
    values = {"status": (record.status,), "fleetName": (reference_path(str(job.fleet)),)}
    return Line(mark_of(record.created_at_s, record.id), values, job.model_dump(mode="json", exclude_none=True), {})


def list_deployment_jobs(store: Store) -> Iterator[DeploymentJob]:
    """Yields all deployment jobs."""
    return (DeploymentJob.model_validate(line.summary) for line in all_lines(store, _KIND, deployment_line))


def list_deployment_jobs_page(store: Store, request: ListDeploymentJobsRequest) -> ListDeploymentJobsResponse:
    """Returns one page of the deployment jobs; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in ("status", "fleetName")}
    found, token = line_page(store, _KIND, deployment_line, request, most=_MOST, filters=filters)
    return ListDeploymentJobsResponse(
        deploymentJobs=tuple(DeploymentJob.model_validate(each) for each in found), nextToken=token
    )


def list_fleets(store: Store) -> Iterator[Fleet]:
    """Yields all fleets."""
    return (summarise_fleet(store, fleet) for fleet in fleets(store))


def list_fleets_page(store: Store, request: ListFleetsRequest) -> ListFleetsResponse:
    """Returns one page of the fleets; the filter is ``name``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    names = wanted_values(request, ("name",)).get("name")
    size, after = page_size(request, _MOST), place_after(request, _FLEET, _PLACE)
    wanted = (each for each in fleets(store) if names is None or each.name in names)
    later = ((mark_of(each.created_at_s, each.name), each) for each in wanted)
    found, token = page_of((each for each in later if after is None or each[0] > after), size, _FLEET)
    return ListFleetsResponse(fleetDetails=tuple(summarise_fleet(store, each) for each in found), nextToken=token)


def list_robots(store: Store) -> Iterator[Robot]:
    """Yields all robots."""
    return (summarise_robot(store, robot) for robot in robots(store))


def list_robots_page(store: Store, request: ListRobotsRequest) -> ListRobotsResponse:
    """Returns one page of the robots; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    wanted = wanted_values(request, ("status", "fleetName"))
    size, after = page_size(request, _MOST), place_after(request, _ROBOT, _PLACE)
    found, token = page_of(_robots(store, after, wanted.get("fleetName"), wanted.get("status")), size, _ROBOT)
    return ListRobotsResponse(robots=found, nextToken=token)


def _robots(
    store: Store, after: Place | None, in_fleets: frozenset[str] | None, statuses: frozenset[str] | None
) -> Iterator[tuple[Place, Robot]]:
    """Yields the robots after a place; only of those that may be wanted is read what was asked of them, and came."""
    for record in robots(store):
        place = mark_of(record.created_at_s, record.name)
        if (after is None or place > after) and (in_fleets is None or record.fleet in in_fleets):
            robot = summarise_robot(store, record)
            if statuses is None or robot.status in statuses:
                yield place, robot
