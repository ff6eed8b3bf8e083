"""Pages of ListRobotApplications and ListSimulationApplications, by name; the versions of one, oldest first."""

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import TypeVar

from specs.robomaker.applications import (
    ApplicationsPage,
    ListRobotApplicationsRequest,
    ListRobotApplicationsResponse,
    ListSimulationApplicationsRequest,
    ListSimulationApplicationsResponse,
    RobotApplicationSummary,
    SimulationApplicationSummary,
)
from specs.robomaker.bundle import Application, ApplicationKind
from specs.robomaker.list_pages import Place, page_of, page_size, place_after, wanted_values
from tasks.applications.describe import summarise_robot_application, summarise_simulation_application
from tasks.applications.versions import listed_application
from tasks.storage.base.keys import applications_prefix
from tasks.storage.base.store import Store

Summary = TypeVar("Summary", bound=RobotApplicationSummary)
_MOST = 100
_ROBOT: ApplicationKind = "robot-application"
_SIMULATION: ApplicationKind = "simulation-application"


def list_robot_applications(store: Store) -> Iterator[RobotApplicationSummary]:
    """Yields the newest version of every robot application."""
    found = _found(store, _ROBOT, ListRobotApplicationsRequest())
    return (summarise_robot_application(store, each) for _, each in found)


def list_simulation_applications(store: Store) -> Iterator[SimulationApplicationSummary]:
    """Yields the newest version of every simulation application."""
    found = _found(store, _SIMULATION, ListSimulationApplicationsRequest())
    return (summarise_simulation_application(store, each) for _, each in found)


def list_robot_applications_page(store: Store, request: ListRobotApplicationsRequest) -> ListRobotApplicationsResponse:
    """Returns one page of the robot applications; filters are ``name`` and ``robotSoftwareSuite``, by its name.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    found = ((place, summarise_robot_application(store, each)) for place, each in _found(store, _ROBOT, request))
    page, token = page_of(_wanted(found, request), page_size(request, _MOST), _ROBOT)
    return ListRobotApplicationsResponse(robotApplicationSummaries=page, nextToken=token)


def list_simulation_applications_page(
    store: Store, request: ListSimulationApplicationsRequest
) -> ListSimulationApplicationsResponse:
    """Returns one page of the simulation applications, as `list_robot_applications_page` does.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    kind = _SIMULATION
    found = ((place, summarise_simulation_application(store, each)) for place, each in _found(store, kind, request))
    page, token = page_of(_wanted(found, request), page_size(request, _MOST), kind)
    return ListSimulationApplicationsResponse(simulationApplicationSummaries=page, nextToken=token)


def _wanted(found: Iterator[tuple[Place, Summary]], request: ApplicationsPage) -> Iterator[tuple[Place, Summary]]:
    suites = wanted_values(request, ("name", "robotSoftwareSuite")).get("robotSoftwareSuite")
    for place, each in found:
        suite = each.robotSoftwareSuite
        if suites is None or (suite and suite.name in suites):
            yield place, each


def _found(store: Store, kind: ApplicationKind, request: ApplicationsPage) -> Iterator[tuple[Place, Application]]:
    """Yields the applications after the last page, each as it was with one of its versions as the newest."""
    names = wanted_values(request, ("name", "robotSoftwareSuite")).get("name")
    after = place_after(request, kind, (str, int))
    for name in sorted(PurePosixPath(key).stem for key in store.keys(applications_prefix(kind))):
        if (after and name < str(after[0])) or (names is not None and name not in names):
            continue
        application = listed_application(store, kind, name)
        for each in _versions(application, request) if application else ():
            place = (name, each.versions[-1].number if each.versions else 0)
            if after is None or place > after:
                yield place, each


def _versions(application: Application, request: ApplicationsPage) -> Iterator[Application]:
    if request.versionQualifier is None or not application.versions:
        yield application
        return
    for count in range(1, len(application.versions) + 1):
        yield application.model_copy(update={"versions": application.versions[:count]})
