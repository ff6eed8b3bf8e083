"""Applications in RoboMaker's words."""

from specs.arn import arn
from specs.robomaker.applications import (
    DescribeRobotApplicationResponse,
    DescribeSimulationApplicationResponse,
    RobotApplicationSummary,
    RobotSoftwareSuite,
    SimulationApplicationSummary,
    SimulationSoftwareSuite,
    Source,
)
from specs.robomaker.bundle import LATEST, Application, ApplicationKind, Version
from tasks.applications.registry import applications, resolve
from tasks.applications.versions import application_name, read_application
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

_ROBOT = RobotSoftwareSuite(name="General")
_SIMULATION = SimulationSoftwareSuite(name="SimulationRuntime")
_REVISION_CHARACTERS = 40


def describe_robot_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeRobotApplicationResponse:
    """Returns a version of a robot application, the newest by default, or an application that has none yet.

    Its sources are where its bundles were taken from, or the bundles in the store.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    document = _described(store, "robot-application", reference, version)
    return DescribeRobotApplicationResponse.model_validate({**document, "robotSoftwareSuite": _ROBOT})


def describe_simulation_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeSimulationApplicationResponse:
    """Returns a version of a simulation application, as `describe_robot_application` does.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    document = _described(store, "simulation-application", reference, version)
    suites = {"simulationSoftwareSuite": _SIMULATION, "robotSoftwareSuite": _ROBOT}
    return DescribeSimulationApplicationResponse.model_validate({**document, **suites})


def list_robot_applications(store: Store) -> list[RobotApplicationSummary]:
    """Returns the newest version of every robot application, by name."""
    return [
        RobotApplicationSummary.model_validate({**_summary(store, each), "robotSoftwareSuite": _ROBOT})
        for each in applications(store, "robot-application")
    ]


def list_simulation_applications(store: Store) -> list[SimulationApplicationSummary]:
    """Returns the newest version of every simulation application, by name."""
    suites = {"simulationSoftwareSuite": _SIMULATION, "robotSoftwareSuite": _ROBOT}
    return [
        SimulationApplicationSummary.model_validate({**_summary(store, each), **suites})
        for each in applications(store, "simulation-application")
    ]


def _described(store: Store, kind: ApplicationKind, reference: str, version: str | None) -> dict[str, object]:
    application = read_application(store, kind, application_name(kind, reference))
    newest = version in {None, LATEST}
    if application and newest and not application.versions:
        sources = tuple(Source.model_validate(source.model_dump()) for source in application.sources)
        summary = {**_summary(store, application), "lastUpdatedAt": None}
        return {**summary, "sources": sources, "revisionId": application.revision or None}
    found = resolve(store, kind, reference, version)
    latest = application.revision if application and newest else ""
    return {
        "arn": arn(kind, store_id(store), found.name),
        "name": found.name,
        "version": str(found.number),
        "sources": _sources(found),
        "revisionId": latest or found.revision or found.digest[:_REVISION_CHARACTERS],
        "lastUpdatedAt": found.created_at_s,
    }


def _summary(store: Store, application: Application) -> dict[str, object]:
    newest = application.versions[-1] if application.versions else None
    return {
        "name": application.name,
        "arn": arn(application.kind, store_id(store), application.name),
        "version": str(newest.number) if newest else LATEST,
        "lastUpdatedAt": newest.created_at_s if newest else None,
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
