"""Pages of ListDeploymentJobs, ListFleets and ListRobots; an item is listed if one of the filters fits."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import DocumentError
from specs.field_types import FilteredPage
from specs.robomaker.deployment import DeploymentJob, ListDeploymentJobsRequest, ListDeploymentJobsResponse
from specs.robomaker.fleet import (
    Fleet,
    ListFleetsRequest,
    ListFleetsResponse,
    ListRobotsRequest,
    ListRobotsResponse,
    Robot,
)
from specs.robomaker.list_filters import filter_pairs
from tasks.deploy.answers.describe import list_deployment_jobs, list_fleets, list_robots
from tasks.storage.base.store import Store

# As many as the answers' lists may hold.
_PAGE, _ROBOTS_PAGE = 200, 1000
T = TypeVar("T", DeploymentJob, Fleet, Robot)
Field = Callable[[T], str | None]


def list_deployment_jobs_page(store: Store, request: ListDeploymentJobsRequest) -> ListDeploymentJobsResponse:
    """Returns one page of the deployment jobs, oldest first; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token is none that a page gave, or a filter has another name.
    """
    fields: Mapping[str, Field[DeploymentJob]] = {
        "status": lambda job: job.status,
        "fleetName": lambda job: _name(job.fleet),
    }
    jobs, token = _page(list_deployment_jobs(store), request, fields, _PAGE)
    return ListDeploymentJobsResponse(deploymentJobs=tuple(jobs), nextToken=token)


def list_fleets_page(store: Store, request: ListFleetsRequest) -> ListFleetsResponse:
    """Returns one page of the fleets, oldest first; the filter is ``name``.

    Raises:
        DocumentError: The token is none that a page gave, or a filter has another name.
    """
    fleets, token = _page(list_fleets(store), request, {"name": lambda fleet: fleet.name}, _PAGE)
    return ListFleetsResponse(fleetDetails=tuple(fleets), nextToken=token)


def list_robots_page(store: Store, request: ListRobotsRequest) -> ListRobotsResponse:
    """Returns one page of the robots, oldest first; filters are ``status`` and ``fleetName``.

    Raises:
        DocumentError: The token is none that a page gave, or a filter has another name.
    """
    fields: Mapping[str, Field[Robot]] = {
        "status": lambda robot: robot.status,
        "fleetName": lambda robot: _name(robot.fleetArn),
    }
    robots, token = _page(list_robots(store), request, fields, _ROBOTS_PAGE)
    return ListRobotsResponse(robots=tuple(robots), nextToken=token)


def _page(
    found: Sequence[T], request: FilteredPage, fields: Mapping[str, Field[T]], longest: int
) -> tuple[Sequence[T], str | None]:
    """Returns what is wanted from where the last page ended, and where the next one begins, if there is one."""
    names = [_name(each.arn) for each in found]
    if request.nextToken and request.nextToken not in names:
        raise _refused("nextToken", request.nextToken, "the nextToken of a page")
    first = names.index(request.nextToken) if request.nextToken else 0
    pairs = filter_pairs(request, fields)
    later = [each for each in found[first:] if not pairs or any(fields[name](each) == value for name, value in pairs)]
    size = min(request.maxResults or longest, longest)
    return later[:size], _name(later[size].arn) if len(later) > size else None


def _name(arn: str | None) -> str:
    return parse_reference(arn).path if arn else ""


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=repr(value), allowed=allowed)], source="simyard")
