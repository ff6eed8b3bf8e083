"""Published applications: bundles under their digest, versions under their number."""

import hashlib
import tempfile
import time
from pathlib import Path

from specs.arn import parse_reference
from specs.base import Fault
from specs.bundle import LATEST, VERSIONS_AT_MOST, Application, ApplicationKind, Version
from specs.errors import (
    BundleRefused,
    DocumentError,
    LimitExceeded,
    ObjectConflict,
    ObjectExists,
    ObjectNotFound,
    ResourceNotFound,
)
from tasks.applications.packing import pack
from tasks.applications.shipped import shipped_application
from tasks.storage.archives import install
from tasks.storage.encoding import decoded, encoded
from tasks.storage.keys import application_key, applications_prefix, bundle_key
from tasks.storage.store import Store

__all__ = ["applications", "pack", "publish", "resolve", "unpack", "with_digest"]


def publish(store: Store, kind: ApplicationKind, name: str, folder: Path, *, shipped: bool = False) -> Version:
    """Returns the version that stands for the folder's content: an old one for old content, else the next number.

    Processes that publish at the same time get different numbers for different content, and the same for the same.

    Args:
        store: Where bundles and versions are kept.
        kind: Whether it runs robots or tests.
        name: The application; made by its first version.
        folder: The bundle.
        shipped: Whether it came with Simyard.

    Raises:
        DocumentError: The folder is no bundle, or the name is none.
        LimitExceeded: A 41st version (semantics 9).
    """
    key = application_key(kind, name)
    body = pack(folder)
    while True:
        application, etag = _read(store, kind, name)
        versions = application.versions if application else ()
        new = _version(kind, name, body, versions, shipped=shipped)
        if new in versions:
            return new
        store.put(bundle_key(new.digest), body)  # first the bytes, then the number that promises them
        after = encoded(Application(kind=kind, name=name, versions=(*versions, new)))
        try:
            store.replace(key, after, etag) if application else store.create(key, after)
        except (ObjectExists, ObjectConflict):  # another process published; look again
            continue
        return new


def with_digest(store: Store, kind: ApplicationKind, reference: str, digest: str) -> Version:
    """Returns the version of an application that stands for a bundle.

    Raises:
        ResourceNotFound: No such application, or none of its versions is that bundle.
        DocumentError: The reference names another kind of resource, or the name is none.
    """
    application, _ = _read(store, kind, _name(kind, reference))
    found = next((known for known in application.versions if known.digest == digest), None) if application else None
    if found is None:
        raise _missing("application", reference, f"a {kind} with the bundle {digest}")
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
    name = _name(kind, reference)
    newest = version in {None, LATEST}
    application, _ = _read(store, kind, name)
    folder = shipped_application(name)
    if folder and (application is None or (newest and application.versions[-1].shipped)):
        published = publish(store, kind, name, folder, shipped=True)
        if newest or str(published.number) == version:
            return published
        application, _ = _read(store, kind, name)
    if application is None:
        raise _missing("application", reference, f"a published {kind}, or one that comes with Simyard")
    if newest:
        return application.versions[-1]
    found = next((known for known in application.versions if str(known.number) == version), None)
    if found is None:
        numbers = ", ".join(str(known.number) for known in application.versions)
        raise _missing("applicationVersion", str(version), f"a version of {name}: {numbers}")
    return found


def applications(store: Store, kind: ApplicationKind) -> list[Application]:
    """Returns all published applications of a kind, by name, for showing to people."""
    names = [Path(key).stem for key in store.keys(applications_prefix(kind))]
    found = (_read(store, kind, name)[0] for name in sorted(names))
    return [application for application in found if application]


def unpack(store: Store, digest: str, cache: Path) -> Path:
    """Returns the folder ``<cache>/<digest>`` with a bundle's files; fetches and unpacks them when it is not there.

    Raises:
        ObjectNotFound: The store has no such bundle.
        BundleRefused: Its bytes are not those that were published, or hold what no bundle may.
        DocumentError: The digest is none.
    """
    key = bundle_key(digest)
    target = cache / digest
    if target.is_dir():
        return target
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".download-", dir=cache) as folder:
        archive = Path(folder) / "bundle.tar"
        store.download(key, archive)
        try:
            install(archive, digest, target)
        except BundleRefused as exc:
            raise BundleRefused(f"{store.url}: {key}: {exc}; publish the application again") from exc
    return target


def _read(store: Store, kind: ApplicationKind, name: str) -> tuple[Application | None, str]:
    key = application_key(kind, name)
    try:
        stored = store.get(key)
    except ObjectNotFound:
        return None, ""
    return decoded(Application, stored, store, key), stored.etag


def _version(kind: ApplicationKind, name: str, body: bytes, versions: tuple[Version, ...], *, shipped: bool) -> Version:
    """Returns the version that stands for a bundle's bytes: the one of ``versions`` that does, else the next."""
    digest = hashlib.sha256(body).hexdigest()
    known = next((version for version in versions if version.digest == digest), None)
    return known or Version(
        kind=kind,
        name=name,
        number=_next_number(name, versions),
        digest=digest,
        size_bytes=len(body),
        created_at_s=time.time(),
        shipped=shipped,
    )


def _next_number(name: str, versions: tuple[Version, ...]) -> int:
    if len(versions) >= VERSIONS_AT_MOST:
        fault = Fault(
            path="application",
            value=f"a new version of {name}",
            allowed=f"at most {VERSIONS_AT_MOST} versions; publish under another name",
        )
        raise LimitExceeded([fault], source=name)
    return len(versions) + 1


def _name(kind: ApplicationKind, reference: str) -> str:
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise DocumentError([Fault(path="application", value=reference, allowed=str(exc))]) from exc
    if parsed.kind not in {None, kind}:
        fault = Fault(path="application", value=reference, allowed=f"the ARN or the name of a {kind}")
        raise DocumentError([fault])
    return parsed.path


def _missing(path: str, value: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound([Fault(path=path, value=repr(value), allowed=allowed)])
