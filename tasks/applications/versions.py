"""An application's one object in the store: read, and changed by compare-and-swap."""

import hashlib
import logging
import time
from collections.abc import Callable, Sequence

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import canonical_json
from specs.errors import (
    DocumentError,
    LimitExceeded,
    ObjectCorrupt,
    ResourceNotFound,
)
from specs.robomaker.bundle import VERSIONS_AT_MOST, Application, ApplicationKind, Build, Version
from tasks.storage.base.keys import application_key
from tasks.storage.base.store import Store, find_document, update
from tasks.storage.tags import Change

_REVISION_CHARACTERS = 40
_LOG = logging.getLogger(__name__)


def read_application(store: Store, kind: ApplicationKind, name: str) -> Application | None:
    """Returns an application that somebody made and nobody deleted, or None."""
    found = _checked(find_document(store, application_key(kind, name), Application), store, kind, name)
    return None if found is None or found.deleted else found


def listed_application(store: Store, kind: ApplicationKind, name: str) -> Application | None:
    """Returns an application for a list; None also if its record is damaged, which the log says."""
    try:
        return read_application(store, kind, name)
    except ObjectCorrupt as exc:
        _LOG.warning("the %s %s is left out of lists: %s", kind, name, exc)
        return None


def known_application(store: Store, kind: ApplicationKind, reference: str) -> Application:
    """Returns an application by name or ARN.

    Raises:
        ResourceNotFound: No such application.
        DocumentError: The reference names another kind of resource, or the name is none.
    """
    found = read_application(store, kind, application_name(kind, reference))
    if found is None:
        raise not_found("application", reference, f"a published {kind}; see simyard list {kind}s")
    return found


def change(
    store: Store, kind: ApplicationKind, name: str, step: Callable[[Application | None, int], Application]
) -> Application:
    """Returns an application after a change, written over exactly what was read.

    Args:
        store: Where it is.
        kind: What it runs.
        name: What it is called.
        step: Returns what it shall be, from what it is (None for one that is not there) and the number that a new
            version would have. Called again when another process changed it meanwhile.
    """

    def changed(found: Application | None) -> Application:
        before = _checked(found, store, kind, name)
        last = _last_number(before) if before else 0
        after = step(None if before is None or before.deleted else before, last + 1)
        after = after.model_copy(update={"last_number": max(_last_number(after), last)})  # also after a deletion
        return before if before and after == before else after

    return update(store, application_key(kind, name), Application, changed)


def change_application_tags(store: Store, kind: ApplicationKind, reference: str, tags: Change) -> Application:
    """Returns an application after its tags were changed; its revision and its versions stay as they are.

    Raises:
        ResourceNotFound: No such application.
        DocumentError: There would be too many.
    """

    def step(before: Application | None, _number: int) -> Application:
        if before is None:
            raise not_found("application", reference, f"a {kind}; see simyard list {kind}s")
        return before.model_copy(update={"tags": tags(before.tags)})

    return change(store, kind, application_name(kind, reference), step)


def with_version(
    before: Application,
    bundles: Sequence[Build],
    *,
    whole: bool,
    shipped: bool,
    number: int,
    brought: bool = False,
    image_digest: str = "",
) -> Application:
    """Returns the application with one more version, or as it is when it has one of these bundles already.

    Args:
        before: The application.
        bundles: What the version stands for.
        whole: Whether the only bundle is for all architectures.
        shipped: Whether it came with Simyard.
        number: The version's.
        brought: Whether a document brings it along; one that a command publishes as well is no document's any more.
        image_digest: Of the container image that its environment names, or empty.

    Raises:
        LimitExceeded: A 41st version (docs/reference/robomaker.md, section 9).
    """
    builds = () if whole else tuple(bundles)
    if known := known_version(before, bundles, whole=whole, image_digest=image_digest):
        return before if brought or not known.brought else _kept(before, known)
    if len(before.versions) >= VERSIONS_AT_MOST:
        value, allowed = (
            f"a new version of {before.name}",
            f"at most {VERSIONS_AT_MOST} versions; delete one: simyard app delete",
        )
        raise LimitExceeded.of("application", value, allowed, source=before.name)
    main = next((build for build in bundles if build.architecture == "X86_64"), bundles[0])
    revision = next_revision(before, [number, *(build.digest for build in bundles)])
    version = Version(
        kind=before.kind,
        name=before.name,
        number=number,
        digest=main.digest,
        size_bytes=main.size_bytes,
        created_at_s=time.time(),
        shipped=shipped,
        brought=brought,
        builds=builds,
        revision=revision,
        platform=before.platform.model_copy(update={"image_digest": image_digest}),
    )
    return before.model_copy(update={"versions": (*before.versions, version), "revision": revision})


def _kept(before: Application, known: Version) -> Application:
    same = (each.model_copy(update={"brought": False}) if each == known else each for each in before.versions)
    return before.model_copy(update={"versions": tuple(same)})


def known_version(
    application: Application, bundles: Sequence[Build], *, whole: bool, image_digest: str = ""
) -> Version | None:
    """Returns the version that stands for exactly these bundles, on the application's platform of now; or None."""
    builds = () if whole else tuple(bundles)
    platform = application.platform.model_copy(update={"image_digest": image_digest})
    same = (each for each in application.versions if each.builds == builds and each.platform == platform)
    return next((each for each in same if builds or each.digest == bundles[0].digest), None)


def next_revision(before: Application, change: Sequence[int | str]) -> str:
    """Returns the revision after a change: another one for every change, also for one that goes back."""
    document: dict[str, JsonValue] = {"before": before.revision, "change": [*change]}
    return hashlib.sha256(canonical_json(document)).hexdigest()[:_REVISION_CHARACTERS]


def require_revision(application: Application, current: str | None) -> None:
    """Does nothing when the application is as the caller has seen it, or when the caller does not care.

    Raises:
        DocumentError: Somebody has changed it since.
    """
    if current is not None and current != application.revision:
        allowed = f"the revision that it has now, {application.revision!r}: somebody has changed it; look at it again"
        raise DocumentError.of("currentRevisionId", repr(current), allowed, source=application.name)


def application_name(kind: ApplicationKind, reference: str) -> str:
    """Returns the name that a reference means.

    Raises:
        DocumentError: It names another kind of resource.
    """
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise DocumentError.of("application", reference, str(exc)) from exc
    if parsed.kind not in {None, kind}:
        raise DocumentError.of("application", reference, f"the ARN or the name of a {kind}")
    return parsed.path


def not_found(path: str, value: str, allowed: str) -> ResourceNotFound:
    """Returns the error that says that something does not exist."""
    return ResourceNotFound.of(path, repr(value), allowed)


def _checked(found: Application | None, store: Store, kind: ApplicationKind, name: str) -> Application | None:
    if found and found.name != name:
        raise ObjectCorrupt(f"{store.url}: {application_key(kind, name)} is the record of {found.name!r}")
    return found


def _last_number(application: Application) -> int:
    return max(application.last_number, *(version.number for version in application.versions), 0)
