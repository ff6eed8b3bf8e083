"""Applications whose bundles somebody puts into a bucket, as RoboMaker had them: made, updated, versioned, deleted.

A version remembers the place and the ETag of each source. Unlike RoboMaker's it also keeps a copy, by digest, so that
robots download what was tested; a source that has changed since is told all the same (`tasks.storage.buckets`).
"""

import os
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from specs.base import Fault
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, ResourceAlreadyExists
from specs.field_types import S3Object
from specs.robomaker.applications import SourceConfig
from specs.robomaker.bundle import ARCHITECTURES, Application, ApplicationKind, Build, Platform, Version
from specs.settings import REGISTRIES
from tasks.applications.registry import add_version, missing_bundles, pack_bundle
from tasks.applications.versions import (
    application_name,
    change,
    known_application,
    next_revision,
    not_found,
    require_revision,
)
from tasks.storage.archives import digest_of, extract
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import etag_now, open_bucket
from tasks.storage.container_image import REGISTRY, image_bundle

_TAG = re.compile(r"(:[A-Za-z0-9_][A-Za-z0-9_.-]*)?(@.*)?$")


def create_application(
    store: Store,
    kind: ApplicationKind,
    name: str,
    sources: Sequence[SourceConfig],
    *,
    platform: Platform | None = None,
    tags: Mapping[str, str] | None = None,
) -> Application:
    """Returns a new application without versions.

    Args:
        store: Where it is made.
        kind: Whether it runs robots or tests.
        name: What it is called.
        sources: Where its bundles lie, one for each architecture; they may come later.
        platform: What it says that it is written for.
        tags: Its tags.

    Raises:
        ResourceAlreadyExists: There is one of that name.
        DocumentError: The name is none, or the sources contradict each other.
    """
    checked = _check_sources(sources)

    def step(before: Application | None, _number: int) -> Application:
        if before:
            raise ResourceAlreadyExists.of("name", name, f"a name that no {kind} has; update it, or publish into it")
        made = Application(
            kind=kind,
            name=name,
            versions=(),
            sources=checked,
            platform=platform or Platform(),
            tags=dict(tags or {}),
            updated_at_s=time.time(),
        )
        return made.model_copy(update={"revision": next_revision(made, [name, _number, *_words(checked)])})

    return change(store, kind, name, step)


def update_application(
    store: Store,
    kind: ApplicationKind,
    reference: str,
    sources: Sequence[SourceConfig] | None,
    current_revision: str | None = None,
    *,
    platform: Platform | None = None,
) -> Application:
    """Returns an application whose next version is made from other sources; versions that are there stay as they are.

    Args:
        store: Where the application is.
        kind: Robot or simulation.
        reference: Its name or ARN.
        sources: Where the next version's bundles lie, one an architecture; None to leave them as they are.
        current_revision: The revision that the caller knows; None to change whatever is there.
        platform: What it says that it is written for; what is None in it stays as it is.

    Raises:
        ResourceNotFound: No such application.
        DocumentError: It was changed since the revision, or the sources contradict each other.
    """
    checked = None if sources is None else _check_sources(sources)
    said = platform.model_dump(exclude_none=True, exclude={"image_digest"}) if platform else {}

    def step(before: Application | None, _number: int) -> Application:
        found = _there(before, kind, reference)
        require_revision(found, current_revision)
        now = found.sources if checked is None else checked
        written = Platform.model_validate({**found.platform.model_dump(), **said})
        revision = next_revision(found, [*_words(now), *([written.model_dump_json()] if said else [])])
        changes = {"sources": now, "platform": written, "revision": revision, "updated_at_s": time.time()}
        return found.model_copy(update=changes)

    return change(store, kind, application_name(kind, reference), step)


def create_version(
    store: Store,
    kind: ApplicationKind,
    reference: str,
    current_revision: str | None = None,
    *,
    etags: Sequence[str] | None = None,
    image_digest: str = "",
    brought: bool = False,
) -> Version:
    """Returns the version that stands for what lies at the application's sources now.

    Args:
        store: Where the application is.
        kind: Robot or simulation.
        reference: Its name or ARN.
        current_revision: The revision that the caller knows; None for whatever is there.
        etags: Those that the sources must have, in any order; None for whatever lies there.
        image_digest: Of the container image that the application's environment names, or empty.
        brought: Whether nobody asked for a version: a job needs it, and it may make room for another.

    Raises:
        ResourceNotFound: No such application.
        DocumentError: It has no sources, was changed since the revision, a source has another ETag, what lies there is
            no bundle, or there is no image that the digest could be of.
        LimitExceeded: A 41st version (docs/reference/robomaker.md, section 9).
        StoreError: A bucket cannot be read.
    """
    found = known_application(store, kind, reference)
    require_revision(found, current_revision)
    uri = (found.platform.environment and found.platform.environment.uri) or ""
    if not found.sources and not uri:
        raise not_found("sources", found.name, "an application with sources; publish a folder, or name some by update")
    _require_image(found, image_digest)
    bundles = [_taken(store, source) for source in found.sources] or [_pulled(store, uri, image_digest)]
    if etags is not None:
        _require_etags(bundles, etags)
    made = add_version(
        store,
        kind,
        found.name,
        bundles,
        whole=False,
        brought=brought,
        current_revision=found.revision,
        image_digest=image_digest,
    )
    missing = missing_bundles(store, bundles)
    for source in found.sources:
        if source.architecture in missing:
            _taken(store, source)
    if missing and not found.sources:
        _pulled(store, uri, image_digest)
    return made


def version_at_sources(store: Store, application: Application) -> Version | None:
    """Returns the newest version that was made of what lies at an application's sources now; None for none.

    Raises:
        StoreError: A bucket cannot be read.
    """
    now = {
        (source.architecture, source.s3Bucket, source.s3Key): etag_now(store, source.s3Bucket or "", source.s3Key or "")
        for source in application.sources
    }
    for version in reversed(application.versions):
        made_of = {
            (build.architecture, build.origin.bucket, build.origin.key): build.origin.etag
            for build in version.builds
            if build.origin
        }
        if made_of == now and version.platform.model_copy(update={"image_digest": ""}) == application.platform:
            return version
    return None


def delete_application(store: Store, kind: ApplicationKind, reference: str, version: str | None = None) -> Application:
    """Returns an application after it, or one of its versions, was deleted.

    Numbers are not given again, also not to an application of the same name. Bundles stay: robots run them, records
    name them.

    Args:
        store: Where the application is.
        kind: Robot or simulation.
        reference: Its name or ARN.
        version: The number of the version; None for the whole application.

    Raises:
        ResourceNotFound: No such application or version.
    """

    def step(before: Application | None, _number: int) -> Application:
        found = _there(before, kind, reference)
        if version is None:
            nothing = {"versions": (), "sources": (), "tags": {}, "platform": Platform()}
            return found.model_copy(update={**nothing, "deleted": True})
        left = tuple(each for each in found.versions if str(each.number) != version)
        if len(left) == len(found.versions):
            raise not_found("applicationVersion", version, f"a version of {found.name}: {found.numbers}")
        return found.model_copy(update={"versions": left, "revision": next_revision(found, ["without", version])})

    return change(store, kind, application_name(kind, reference), step)


def _require_image(found: Application, image_digest: str) -> None:
    environment = found.platform.environment
    if image_digest and not (environment and environment.uri):
        allowed = f"none: {found.name} has no environment whose image it could be of"
        raise DocumentError.of("imageDigest", image_digest, allowed)


def _require_etags(bundles: Sequence[Build], etags: Sequence[str]) -> None:
    """Does nothing when the ETags are those of the sources, each of one and none missing."""
    found = sorted(build.origin.etag or "" for build in bundles if build.origin)
    given = sorted(each.strip('"') for each in etags)
    if given != found:
        allowed = f"the ETags of what lies at the sources now: {', '.join(found)}"
        raise DocumentError.of("s3Etags", ", ".join(given) or "none", allowed)


def _there(before: Application | None, kind: ApplicationKind, reference: str) -> Application:
    if before is None:
        raise not_found("application", reference, f"a {kind}; see simyard list {kind}s")
    return before


def _check_sources(sources: Sequence[SourceConfig]) -> tuple[SourceConfig, ...]:
    """Returns the sources, complete and in one order."""
    whole = [source.model_copy(update={"architecture": source.architecture or "X86_64"}) for source in sources]
    faults = [
        Fault(path=f"sources[{number}]", value=str(source.architecture), allowed="an s3Bucket and an s3Key")
        for number, source in enumerate(whole)
        if not source.s3Bucket or not source.s3Key
    ]
    given = [source.architecture for source in whole]
    doubled = [each for each in ARCHITECTURES if given.count(each) > 1]
    faults += [Fault(path="sources", value=each, allowed="one source for each architecture") for each in doubled]
    if faults:
        raise DocumentError(faults, source="application")
    return tuple(source for each in ARCHITECTURES for source in whole if source.architecture == each)


def _words(sources: Sequence[SourceConfig]) -> list[str]:
    return [f"{source.architecture}={source.s3Bucket}/{source.s3Key}" for source in sources]


def _taken(store: Store, source: SourceConfig) -> Build:
    """Returns a source's bundle after it was copied into the store and tried."""
    bucket, key = source.s3Bucket or "", source.s3Key or ""
    place = open_bucket(store, bucket)
    with tempfile.TemporaryDirectory(prefix="simyard-source-") as folder:
        archive = Path(folder) / "bundle"
        try:
            etag = _download(place, key, archive)
            extract(archive, Path(folder) / "tried")
        except (ObjectNotFound, BundleRefused) as exc:
            path = f"sources[{source.architecture}]"
            allowed = f"a bundle, a plain tar: {exc}"
            raise DocumentError.of(path, f"s3://{bucket}/{key}", allowed) from exc
        digest = digest_of(archive)
        store.upload(bundle_key(digest), archive)
        origin = S3Object(bucket=bucket, key=key, etag=etag.strip('"'))
        size = archive.stat().st_size
    return Build(architecture=source.architecture or "X86_64", digest=digest, size_bytes=size, origin=origin)


def _pulled(store: Store, uri: str, digest: str) -> Build:
    """Returns the bundle of a registry's container image, after it was put into the store.

    Who calls over HTTP chooses the registry: one that the machine's owner has not named is not asked.
    """
    known = os.environ.get(REGISTRIES, "").replace(",", " ").split()
    if (host := uri.partition("/")[0]) not in known:
        allowed = f"an image of a registry that this machine may ask: {REGISTRIES} has {', '.join(known) or 'none'}"
        raise DocumentError.of("environment.uri", uri, f"{allowed}; {REGISTRIES}={host} adds it")
    if not digest:
        raise DocumentError.of("imageDigest", "none", f"the SHA-256 of the image of {uri} that is meant")
    name = f"{host}/{_TAG.sub('', uri.partition('/')[2])}"
    try:
        folder = image_bundle(f"{REGISTRY}{name}@{digest.lower()}", Path())
    except BundleRefused as exc:
        raise DocumentError.of("environment.uri", uri, f"a container image that can be run here; {exc}") from exc
    return pack_bundle(store, "X86_64", folder)


def _download(place: Store, key: str, archive: Path) -> str:
    """Returns the ETag of what was downloaded."""
    etag = place.etag(key)
    place.download(key, archive)
    if place.etag(key) != etag:
        raise BundleRefused("it was changed while it was read; try again")
    return etag
