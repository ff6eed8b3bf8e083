"""Whether what a version was made from is still what it was (semantics 9).

RoboMaker keeps no copy of a bundle, so a source that changes breaks the versions that were made from it. Here the copy
is in the store and would still run; but who rebuilds in place believes that the new bytes are what is deployed.
"""

from specs.base import Fault
from specs.bundle import Version
from specs.common import S3Object
from specs.errors import ObjectNotFound
from tasks.storage.buckets import open_bucket
from tasks.storage.store import Store

MISMATCHED = {
    "robot-application": "RobotApplicationVersionMismatchedEtag",
    "simulation-application": "SimulationApplicationVersionMismatchedEtag",
}


def changed_sources(store: Store, version: Version, path: str) -> list[Fault]:
    """Returns a fault for each source whose ETag is another than when the version was made.

    Args:
        store: Where the version is.
        version: The version; one that was packed from a folder has no sources that could change.
        path: Where the document names it.

    Raises:
        StoreError: A bucket cannot be asked.
    """
    faults: list[Fault] = []
    for build in version.builds:
        if build.origin and (found := _etag(store, build.origin)) != build.origin.etag:
            place = f"s3://{build.origin.bucket}/{build.origin.key}"
            what = f"{place}, which {f'has ETag {found}' if found else 'is gone'} ({MISMATCHED[version.kind]})"
            allowed = f"ETag {build.origin.etag}, which version {version.number} was made of; make a new version"
            faults.append(Fault(path=path, value=what, allowed=allowed))
    return faults


def _etag(store: Store, origin: S3Object) -> str:
    try:
        return open_bucket(store, origin.bucket).etag(origin.key).strip('"')
    except ObjectNotFound:
        return ""
