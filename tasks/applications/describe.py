"""Published applications in RoboMaker's words."""

from specs.applications import (
    DescribeRobotApplicationResponse,
    DescribeSimulationApplicationResponse,
    RobotApplicationSummary,
    RobotSoftwareSuite,
    SimulationApplicationSummary,
    SimulationSoftwareSuite,
    Source,
)
from specs.arn import arn
from specs.bundle import Version
from tasks.applications.publishing import applications, resolve
from tasks.storage.keys import bundle_key
from tasks.storage.opening import store_id
from tasks.storage.store import Store

_ROBOT = RobotSoftwareSuite(name="General")
_SIMULATION = SimulationSoftwareSuite(name="SimulationRuntime")
_REVISION_CHARACTERS = 40


def describe_robot_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeRobotApplicationResponse:
    """Returns a version of a robot application, the newest by default; its source is the bundle in the store.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    found = resolve(store, "robot-application", reference, version)
    return DescribeRobotApplicationResponse(
        arn=_arn(store, found),
        name=found.name,
        version=str(found.number),
        sources=(_source(found),),
        robotSoftwareSuite=_ROBOT,
        revisionId=found.digest[:_REVISION_CHARACTERS],
        lastUpdatedAt=found.created_at_s,
    )


def describe_simulation_application(
    store: Store, reference: str, version: str | None = None
) -> DescribeSimulationApplicationResponse:
    """Returns a version of a simulation application, the newest by default; its source is the bundle in the store.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names something else.
    """
    found = resolve(store, "simulation-application", reference, version)
    return DescribeSimulationApplicationResponse(
        arn=_arn(store, found),
        name=found.name,
        version=str(found.number),
        sources=(_source(found),),
        simulationSoftwareSuite=_SIMULATION,
        robotSoftwareSuite=_ROBOT,
        revisionId=found.digest[:_REVISION_CHARACTERS],
        lastUpdatedAt=found.created_at_s,
    )


def list_robot_applications(store: Store) -> list[RobotApplicationSummary]:
    """Returns the newest version of every published robot application, by name."""
    newest = [application.versions[-1] for application in applications(store, "robot-application")]
    return [
        RobotApplicationSummary(
            name=version.name,
            arn=_arn(store, version),
            version=str(version.number),
            lastUpdatedAt=version.created_at_s,
            robotSoftwareSuite=_ROBOT,
        )
        for version in newest
    ]


def list_simulation_applications(store: Store) -> list[SimulationApplicationSummary]:
    """Returns the newest version of every published simulation application, by name."""
    newest = [application.versions[-1] for application in applications(store, "simulation-application")]
    return [
        SimulationApplicationSummary(
            name=version.name,
            arn=_arn(store, version),
            version=str(version.number),
            lastUpdatedAt=version.created_at_s,
            robotSoftwareSuite=_ROBOT,
            simulationSoftwareSuite=_SIMULATION,
        )
        for version in newest
    ]


def _arn(store: Store, version: Version) -> str:
    return arn(version.kind, store_id(store), version.name)


def _source(version: Version) -> Source:
    # No bucket: the bundle lies in the store itself. No architecture: it is the same bytes on all of them.
    return Source(s3Key=bundle_key(version.digest), etag=version.digest)
