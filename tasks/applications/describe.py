"""Applications in RoboMaker's words."""

from specs.arn import arn
from specs.errors import StoreError
from specs.robomaker.applications import (
    DescribeRobotApplicationResponse,
    DescribeSimulationApplicationResponse,
    RobotApplicationSummary,
    RobotSoftwareSuite,
    SimulationApplicationSummary,
    SimulationSoftwareSuite,
    Source,
    SourceConfig,
)
from specs.robomaker.bundle import LATEST, Application, ApplicationKind, Platform, Version
from tasks.applications.registry import resolve
from tasks.applications.versions import application_name, read_application
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import etag_now
from tasks.storage.store_url import store_id

_ROBOT = RobotSoftwareSuite(name="General")
_SIMULATION = SimulationSoftwareSuite(name="SimulationRuntime")
_REVISION_CHARACTERS = 40


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
        "robotSoftwareSuite": platform.robot_software_suite or _ROBOT,
        "environment": platform.environment,
    }
    if kind == "robot-application":
        return said
    return said | {
        "simulationSoftwareSuite": platform.simulation_software_suite or _SIMULATION,
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
