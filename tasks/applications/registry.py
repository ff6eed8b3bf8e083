"""Published applications: bundles under their digest, versions under their number, and those that come with Simyard.

A bundle's folder is packed into an archive with the same bytes wherever and whenever that is done. Jobs whose bundle is
gone, changed, or must not be read fail with RoboMaker's codes.
"""

import io
import shutil
import stat
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from specs.base import Fault
from specs.data.episode import Failure
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, StoreAccessDenied, StoreError
from specs.field_types import Architecture
from specs.robomaker.bundle import ARCHITECTURES, LATEST, Application, ApplicationKind, Build, Version
from specs.robomaker.simulation import SimulationJobErrorCode
from specs.rules import meant
from tasks.applications.versions import (
    application_name,
    change,
    known_version,
    listed_application,
    not_found,
    read_application,
    require_revision,
    with_version,
)
from tasks.storage.archives import LIMITS, digest_of, safe_parts
from tasks.storage.base.keys import applications_prefix, bundle_key
from tasks.storage.base.store import Store
from tasks.storage.sealed_bundle import (
    SHIPPED_HOMES,
    bundle_entries,
    seal_bundle,
    sealed_files,
    stored_archive,
    write_archive,
)

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


def pack(folder: Path) -> bytes:
    """Returns what `write_bundle` writes of a folder."""
    buffer = io.BytesIO()
    write_bundle(folder, buffer)
    return buffer.getvalue()


def write_bundle(folder: Path, target: IO[bytes]) -> None:
    """Writes the folder as a plain tar: sorted, without owners or times, with only the executable bit of the modes.

    Hidden leavings of tools (``__pycache__``, ``.git``, ``.DS_Store``) are left out.

    Args:
        folder: Holds regular files and directories only, at least one file.
        target: Where to.

    Raises:
        DocumentError: No such folder, no file in it, a link or device, or a name that could not be unpacked safely.
    """
    entries = list(bundle_entries(folder)) if folder.is_dir() else []
    faults = [fault for path, name in entries if (fault := _fault(path, name))]
    if not folder.is_dir():
        faults = [Fault(path="source", value=str(folder), allowed="a folder that exists")]
    elif not any(path.is_file() for path, _ in entries):
        faults = [Fault(path="source", value=str(folder), allowed="a folder with at least one file"), *faults]
    if faults:
        raise DocumentError(faults, source=f"bundle {folder}")
    write_archive(entries, target)


def _fault(path: Path, name: str) -> Fault | None:
    mode = path.lstat().st_mode
    if stat.S_ISLNK(mode):
        return Fault(path=name, value="symbolic link", allowed="regular files and directories; copy what it points to")
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        return Fault(path=name, value="device, socket or pipe", allowed="regular files and directories")
    try:
        safe_parts(name)
    except BundleRefused:
        return Fault(path=name, value="its name", allowed=f"printable characters, at most {LIMITS.depth} levels deep")
    return None


def shipped_application(name: str) -> Path | None:
    """Returns the folder of an application that comes with Simyard, or None when none has that name."""
    return next((home / name for home in SHIPPED_HOMES if name in _names(home)), None)


def _names(home: Path) -> list[str]:
    # A listing, not a path made from the name, so that no name can lead elsewhere.
    return [path.name for path in home.iterdir() if path.is_dir()] if home.is_dir() else []


def publish_bundle(
    store: Store,
    kind: ApplicationKind,
    name: str,
    source: Path | Mapping[Architecture, Path],
    *,
    shipped: bool = False,
    brought: bool = False,
    current_revision: str | None = None,
) -> Version:
    """Returns the version that stands for the folder's content: an old one for old content, else the next number.

    Processes that publish at the same time get different numbers for different content, and the same for the same.

    Args:
        store: Where bundles and versions are kept.
        kind: Whether it runs robots or tests.
        name: The application; made by its first version.
        source: The bundle, which is for all architectures; or one for each of some.
        shipped: Whether it came with Simyard.
        brought: Whether a document brings it along.
        current_revision: The application's as the caller has seen it; None for any.

    Raises:
        DocumentError: A folder is no bundle, the name is none, or the application was changed since.
        LimitExceeded: A 41st version (docs/reference/robomaker.md, section 9).
    """
    folders: Mapping[Architecture, Path] = {"X86_64": source} if isinstance(source, Path) else source
    bundles = [pack_bundle(store, each, folders[each]) for each in ARCHITECTURES if each in folders]
    made = add_version(
        store,
        kind,
        name,
        bundles,
        whole=isinstance(source, Path),
        shipped=shipped,
        brought=brought,
        current_revision=current_revision,
    )
    for each in missing_bundles(store, bundles):
        pack_bundle(store, each, folders[each])
    return made


def missing_bundles(store: Store, bundles: Sequence[Build]) -> list[Architecture]:
    """Returns those of a version's bundles, by architecture, that a gc removed before the version named them.

    Where a store cannot remove and compare in one step, a gc may remove what was written again at that moment. It looks
    for names afterwards, as this looks for bundles after they were named: one of the two sees the other.
    """
    return [each.architecture for each in bundles if not store.exists(bundle_key(each.digest))]


def add_version(
    store: Store,
    kind: ApplicationKind,
    name: str,
    bundles: Sequence[Build],
    *,
    whole: bool,
    shipped: bool = False,
    brought: bool = False,
    current_revision: str | None = None,
    image_digest: str = "",
) -> Version:
    """Returns the version that stands for bundles which are in the store; the rest as in `publish`.

    Args:
        store: Where bundles and versions are.
        kind: Robot or simulation.
        name: The application's name.
        bundles: The builds of the version, one an architecture.
        whole: Whether the only bundle is for all architectures.
        shipped: Whether the application comes with Simyard.
        brought: Whether a document brings it along.
        current_revision: The revision that the caller knows; None to change whatever is there.
        image_digest: Of the container image that the application's environment names, or empty.
    """

    def step(before: Application | None, number: int) -> Application:
        application = before or Application(kind=kind, name=name, versions=())
        require_revision(application, current_revision)
        return with_version(
            application,
            bundles,
            whole=whole,
            shipped=shipped,
            brought=brought,
            number=number,
            image_digest=image_digest,
        )

    made = known_version(change(store, kind, name, step), bundles, whole=whole, image_digest=image_digest)
    if made is None:
        raise AssertionError(f"{name} has no version of what was just published")
    return made


def find_by_digest(store: Store, kind: ApplicationKind, reference: str, digest: str) -> Version:
    """Returns the version of an application that stands for a bundle.

    Args:
        store: Where the application is.
        kind: Robot or simulation.
        reference: Its name or ARN.
        digest: SHA-256 of the bundle.

    Raises:
        ResourceNotFound: No such application, or none of its versions is that bundle.
        DocumentError: The reference names another kind of resource, or the name is none.
    """
    application = read_application(store, kind, application_name(kind, reference))
    found = next((known for known in application.versions if known.digest == digest), None) if application else None
    if found is None:
        raise not_found("application", reference, f"a {kind} with the bundle {digest}")
    return found


def resolve(store: Store, kind: ApplicationKind, reference: str, version: str | None = None) -> Version:
    """Returns the version that a document means.

    An application that comes with Simyard is published when it is first referred to; ``$LATEST`` follows what comes
    with this installation until somebody publishes under the name.

    Args:
        store: Where versions are kept.
        kind: What the document expects.
        reference: A plain name, or an ARN of this store or RoboMaker.
        version: A number, or ``$LATEST`` or None for the newest.

    Raises:
        ResourceNotFound: No such application or version.
        DocumentError: The reference names another kind of resource, or the name is none.
    """
    name = application_name(kind, reference)
    newest = version in {None, LATEST}
    application = read_application(store, kind, name)
    folder = shipped_application(name)
    if folder and (application is None or (newest and application.versions and application.versions[-1].shipped)):
        published = publish_bundle(store, kind, name, folder, shipped=True)
        if newest or str(published.number) == version:
            return published
        application = read_application(store, kind, name)
    if application is None:
        raise not_found("application", reference, _choice(store, kind, name))
    if newest and application.versions:
        return application.versions[-1]
    found = next((known for known in application.versions if str(known.number) == version), None)
    if found is None:
        raise not_found("applicationVersion", str(version), f"a version of {name}: {application.numbers}")
    return found


def _choice(store: Store, kind: ApplicationKind, name: str) -> str:
    """Returns which applications a name may be of, the one that was probably meant first."""
    known = [Path(key).stem for key in store.keys(applications_prefix(kind))]
    known += [each for home in SHIPPED_HOMES for each in _names(home)]
    command = f"simyard app publish {name} FOLDER" + (" --kind simulation" if kind == "simulation-application" else "")
    return f"{meant(name, known)}a published {kind}, or one that comes with Simyard; {command} publishes one"


def applications(store: Store, kind: ApplicationKind) -> list[Application]:
    """Returns all applications of a kind, by name, for showing to people."""
    names = [Path(key).stem for key in store.keys(applications_prefix(kind))]
    found = (listed_application(store, kind, name) for name in sorted(names))
    return [application for application in found if application]


def unpack(store: Store, digest: str, cache: Path) -> Path:
    """Returns the folder of a bundle's files, read-only; fetches and unpacks them when they are not there.

    Files that are there are compared with the bundle each time: an application that writes beside itself, however it
    does, changes nothing for the next one that asks.

    Raises:
        ObjectNotFound: The store has no such bundle.
        BundleRefused: Its bytes are not those that were published, or hold what no bundle may.
        DocumentError: The digest is none.
    """
    key = bundle_key(digest)
    entry = cache / digest
    if files := sealed_files(entry, digest):
        return files
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".download-", dir=cache) as folder:
        archive = Path(folder) / "bundle.tar"
        if kept := stored_archive(entry, digest):
            shutil.copyfile(kept, archive)
        else:
            _fetch(store, key, archive)
        try:
            return seal_bundle(archive, entry, digest)
        except BundleRefused as exc:
            raise BundleRefused(f"{store.url}: {key}: {exc}; publish the application again") from exc


def _fetch(store: Store, key: str, archive: Path) -> None:
    try:
        store.download(key, archive)
    except ObjectNotFound as exc:
        raise ObjectNotFound(f"{store.url}: {key} is not there any more; publish the application again") from exc


def pack_bundle(store: Store, architecture: Architecture, folder: Path) -> Build:
    """Returns a folder's bundle after it was written: first the bytes, then the number that promises them."""
    with tempfile.TemporaryDirectory(prefix="simyard-bundle-") as made:
        archive = Path(made) / "bundle.tar"  # a container image is as large as memory
        with archive.open("wb") as target:
            write_bundle(folder, target)
        digest = digest_of(archive)
        store.upload(bundle_key(digest), archive)
        return Build(architecture=architecture, digest=digest, size_bytes=archive.stat().st_size)


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
