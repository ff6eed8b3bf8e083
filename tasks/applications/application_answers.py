"""Applications in RoboMaker's words: one of them, pages by name, and the versions of one, oldest first."""

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import TypeVar

from specs.arn import arn
from specs.errors import StoreError
from specs.robomaker.applications import (
    ApplicationsPage,
    DescribeRobotApplicationResponse,
    DescribeSimulationApplicationResponse,
    ListRobotApplicationsRequest,
    ListRobotApplicationsResponse,
    ListSimulationApplicationsRequest,
    ListSimulationApplicationsResponse,
    RobotApplicationSummary,
    RobotSoftwareSuite,
    SimulationApplicationSummary,
    SimulationSoftwareSuite,
    Source,
    SourceConfig,
)
from specs.robomaker.bundle import LATEST, Application, ApplicationKind, Platform, Version
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from tasks.applications.registry import resolve
from tasks.applications.versions import application_name, listed_application, read_application
from tasks.storage.base.keys import applications_prefix, bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import etag_now
from tasks.storage.store_url import store_id

_ROBOT_SUITE = RobotSoftwareSuite(name="General")
_SIMULATION_SUITE = SimulationSoftwareSuite(name="SimulationRuntime")
_REVISION_CHARACTERS = 40
Summary = TypeVar("Summary", bound=RobotApplicationSummary)
_MOST = 100
_ROBOT: ApplicationKind = "robot-application"
_SIMULATION: ApplicationKind = "simulation-application"


def describe_robot_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeRobotApplicationResponse:
    """Returns a version of a robot application, the newest by default, or an application that has none yet.

    Its sources are where its bundles were taken from, or the bundles in the store. ``$LATEST`` of an application whose
    bundles somebody puts into a bucket is where they lie, and what it says of itself, now.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    return DescribeRobotApplicationResponse.model_validate(_described(store, "robot-application", reference, version))


def describe_simulation_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeSimulationApplicationResponse:
    """Returns a version of a simulation application, as `describe_robot_application` does.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    return DescribeSimulationApplicationResponse.model_validate(
        _described(store, "simulation-application", reference, version)
    )


def summarise_robot_application(store: Store, application: Application) -> RobotApplicationSummary:
    """Returns a robot application's line in a list, as of the newest of its versions."""
    return RobotApplicationSummary.model_validate(_summary(store, application))


def summarise_simulation_application(store: Store, application: Application) -> SimulationApplicationSummary:
    """Returns a simulation application's line in a list, as of the newest of its versions."""
    return SimulationApplicationSummary.model_validate(_summary(store, application))


def _described(store: Store, kind: ApplicationKind, reference: str, version: str | None) -> dict[str, object]:
    application = read_application(store, kind, application_name(kind, reference))
    newest = version in {None, LATEST}
    if application and newest and (not application.versions or (version == LATEST and application.sources)):
        return _latest(store, application)
    found = resolve(store, kind, reference, version)
    application = application or read_application(store, kind, found.name)
    latest = application.revision if application and newest else ""
    return {
        "arn": arn(kind, store_id(store), found.name),
        "name": found.name,
        "version": str(found.number),
        "sources": _sources(found),
        "revisionId": latest or found.revision or found.digest[:_REVISION_CHARACTERS],
        "lastUpdatedAt": found.created_at_s,
        "imageDigest": found.platform.image_digest or None,
        "tags": (application.tags if application else None) or None,
        **_platform(kind, found.platform),
    }


def _latest(store: Store, application: Application) -> dict[str, object]:
    """Returns what ``$LATEST`` of an application stands for that has sources, or no version yet."""
    return {
        "arn": arn(application.kind, store_id(store), application.name),
        "name": application.name,
        "version": LATEST,
        "sources": tuple(
            Source.model_validate({**source.model_dump(), "etag": _etag_now(store, source)})
            for source in application.sources
        ),
        "revisionId": application.revision or None,
        "lastUpdatedAt": application.updated_at_s or None,
        "tags": application.tags or None,
        **_platform(application.kind, application.platform),
    }


def _etag_now(store: Store, source: SourceConfig) -> str | None:
    try:
        return etag_now(store, source.s3Bucket or "", source.s3Key or "") or None
    except StoreError:  # nobody may look: who makes a version of it is told so
        return None


def _platform(kind: ApplicationKind, platform: Platform) -> dict[str, object]:
    """Returns what was said of an application; what a command or a document published is Simyard's own."""
    said: dict[str, object] = {
        "robotSoftwareSuite": platform.robot_software_suite or _ROBOT_SUITE,
        "environment": platform.environment,
    }
    if kind == "robot-application":
        return said
    return said | {
        "simulationSoftwareSuite": platform.simulation_software_suite or _SIMULATION_SUITE,
        "renderingEngine": platform.rendering_engine,
    }


def _summary(store: Store, application: Application) -> dict[str, object]:
    newest = application.versions[-1] if application.versions else None
    suites = _platform(application.kind, newest.platform if newest else application.platform)
    return {
        "name": application.name,
        "arn": arn(application.kind, store_id(store), application.name),
        "version": str(newest.number) if newest else LATEST,
        "lastUpdatedAt": newest.created_at_s if newest else application.updated_at_s or None,
        **{name: suite for name, suite in suites.items() if name.endswith("Suite")},
    }


def _sources(version: Version) -> tuple[Source, ...]:
    if not version.builds:
        # No bucket: the bundle lies in the store itself. No architecture: it is the same bytes on all of them.
        return (Source(s3Key=bundle_key(version.digest), etag=version.digest),)
    return tuple(
        Source(
            s3Bucket=build.origin.bucket if build.origin else None,
            s3Key=build.origin.key if build.origin else bundle_key(build.digest),
            etag=build.origin.etag if build.origin else build.digest,
            architecture=build.architecture,
        )
        for build in version.builds
    )


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
