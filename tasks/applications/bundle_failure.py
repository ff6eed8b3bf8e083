"""Why jobs fail whose application's bundle is gone, changed, or must not be read: RoboMaker's codes."""

from collections.abc import Mapping

from specs.data.episode import Failure
from specs.errors import BundleRefused, ObjectNotFound, StoreAccessDenied, StoreError
from specs.robomaker.bundle import ApplicationKind
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store

BUNDLE_ERRORS = (BundleRefused, ObjectNotFound, StoreAccessDenied)
"""What unpacking a bundle raises that `bundle_failure` can explain."""
_INVALID: Mapping[ApplicationKind, SimulationJobErrorCode] = {
    "robot-application": "InvalidBundleRobotApplication",
    "simulation-application": "InvalidBundleSimulationApplication",
}
_DENIED: Mapping[ApplicationKind, SimulationJobErrorCode] = {
    "robot-application": "BadPermissionsRobotApplication",
    "simulation-application": "BadPermissionsSimulationApplication",
}


def bundle_failure(
    store: Store, kind: ApplicationKind, version: str, digest: str, error: BundleRefused | StoreError
) -> Failure:
    """Returns why jobs cannot run an application; it names no place of this machine, as rows must not.

    Args:
        store: Where the bundle belongs.
        kind: Whether it is a robot's or a scenario's.
        version: The application and its version, for a person.
        digest: The bundle's.
        error: One of `BUNDLE_ERRORS`, which fetching and unpacking it raised.

    Raises:
        StoreAccessDenied: It is not the bundle that is refused, but this machine's disk.
    """
    again = f"simyard app publish {version.partition(' ')[0]} FOLDER, with what it was made of, puts it back"
    if isinstance(error, StoreAccessDenied):
        if not _is_refused(store, digest):
            raise error
        rights = "let this machine's credentials read the folder bundles of the store"
        return Failure(_DENIED[kind], f"the bundle of {version} must not be read: {rights}")
    if isinstance(error, ObjectNotFound):
        return Failure(_INVALID[kind], f"the bundle of {version} is not in the store any more: {again}")
    return Failure(_INVALID[kind], f"the bundle of {version} is not what was published: {again}")


def _is_refused(store: Store, digest: str) -> bool:
    try:
        next(store.blocks(bundle_key(digest)), b"")
    except StoreAccessDenied:
        return True
    return False
