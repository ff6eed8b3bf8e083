"""Room for one more version of an application that a document brings along: RoboMaker allows 40 of each.

A document publishes a version at each change of its folder, so that a store which is kept reaches the limit some day.
What nobody refers to goes then, the oldest first. Its bundle stays for as long as a record names it.
"""

import logging
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from pydantic import JsonValue

from specs.base import canonical_document
from specs.errors import LimitExceeded, ResourceNotFound
from specs.job_kinds import JOB_KINDS
from specs.pipeline.document import PipelineSpec
from specs.robomaker.bundle import VERSIONS_AT_MOST, Application, ApplicationKind, Version
from tasks.applications.bucket_sources import create_version, delete_application, version_at_sources
from tasks.applications.registry import publish_bundle, resolve
from tasks.applications.versions import application_name, read_application
from tasks.housekeeping.object_kinds import digests_in
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import JobRecord, is_terminal, records
from tasks.storage.jobs.runs import KIND as RUN

_FIRST_TOLD = VERSIONS_AT_MOST * 3 // 4
_KEPT_DEPLOYMENTS = 2  # what a fleet runs, and what it goes back to
_LOG = logging.getLogger(__name__)


def publish_brought(store: Store, kind: ApplicationKind, name: str, folder: Path, spec: PipelineSpec) -> Version:
    """Returns the version of a folder that a document brings along; makes room for it if there is none.

    Only versions that a document brought go; what somebody published with a command stays.

    Args:
        store: Where versions are.
        kind: Robot or simulation.
        name: The application's name.
        folder: Its bundle.
        spec: The document, which may name older versions.

    Raises:
        DocumentError: The folder is no bundle.
        LimitExceeded: There are 40 versions, and none of them may go.
    """
    while True:
        try:
            return publish_bundle(store, kind, name, folder, brought=True)
        except LimitExceeded as exc:
            _make_room(store, kind, name, spec, exc)  # another run may take it first: then there is to be more


def latest_version(store: Store, kind: ApplicationKind, reference: str) -> Version:
    """Returns what ``$LATEST`` stands for when a call of RoboMaker's names it.

    Of an application whose bundles somebody puts into a bucket it is what lies there now, as it was RoboMaker's: a
    version is made of it if there is none. Of any other it is the newest version.

    Raises:
        ResourceNotFound: No such application, or it has neither sources nor a version.
        DocumentError: What lies there is no bundle.
        LimitExceeded: There are 40 versions, and none of them may go.
    """
    name = application_name(kind, reference)
    application = read_application(store, kind, name)
    if application is None or not application.sources:
        return resolve(store, kind, reference)
    while True:
        if known := version_at_sources(store, application):
            return known
        try:
            return create_version(store, kind, name, brought=True)
        except LimitExceeded as exc:
            _make_room(store, kind, name, None, exc)


def _make_room(store: Store, kind: ApplicationKind, name: str, spec: PipelineSpec | None, why: LimitExceeded) -> None:
    """Deletes the oldest version that may go.

    Raises:
        LimitExceeded: None of them may.
    """
    free = free_versions(store, kind, name, spec)
    oldest = next((version for version in free if version.brought), None)
    if oldest is None:
        raise limit_exceeded(name, kind, free) from why
    with suppress(ResourceNotFound):  # another run has deleted it
        delete_application(store, kind, name, str(oldest.number))
    _LOG.info("%s version %d is deleted: it has %d, and nothing refers to it", name, oldest.number, VERSIONS_AT_MOST)


def limit_exceeded(name: str, kind: ApplicationKind, free: Iterable[Version]) -> LimitExceeded:
    """Returns the error of a 41st version, with the versions that may be deleted and the command for the oldest."""
    numbers = [version.number for version in free]
    word = kind.removesuffix("-application")
    command = f"simyard app delete {name} --kind {word} --version {numbers[0] if numbers else 'NUMBER'}"
    listed = ", ".join(map(str, numbers))
    found = f"nothing refers to {listed}" if numbers else "a fleet, a document or a run refers to each of them"
    allowed = f"at most {VERSIONS_AT_MOST} versions; {found}; delete one: {command}"
    return LimitExceeded.of("application", f"a new version of {name}", allowed, source=name)


# A gate's other version and a deployment's, and the one that a search is against.
_NAMES_VERSION = frozenset({"applicationVersion", "against"})


def free_versions(store: Store, kind: ApplicationKind, name: str, spec: PipelineSpec | None = None) -> list[Version]:
    """Returns the versions that nothing refers to, oldest first; never the newest.

    A robot refers to what it runs and shall run, a fleet to its last two successful deployments, a job that has not
    ended to what it tests, a run to the version its gate compared with, and a document to the numbers in it.

    Args:
        store: Where versions and records are.
        kind: Robot or simulation.
        name: The application's name.
        spec: A document that may name versions; None for none but those that ran.
    """
    application = read_application(store, kind, name)
    if application is None:
        return []
    runs = records(store, RUN)
    needed = frozenset[str]().union(_of_members(store), _of_jobs(store), _of_gates(runs))
    numbers = {*_numbers(canonical_document(spec) if spec else None)}
    numbers.update(number for run in runs for number in _numbers(run.request.get("spec")))
    return [
        version
        for version in application.versions[:-1]
        if not needed & {version.digest, *version.digests.values()} and str(version.number) not in numbers
    ]


def version_lines(spec: PipelineSpec, before: Store, after: Store) -> Iterator[str]:
    """Yields a line for each application of the document that has nearly as many versions as it may have.

    Args:
        spec: The document.
        before: The store as it is.
        after: As a run leaves it.
    """
    for source in spec.applications:
        kind: ApplicationKind = "robot-application" if source.kind == "robot" else "simulation-application"
        old, new = read_application(before, kind, source.name), read_application(after, kind, source.name)
        if new is None or len(new.versions) < _FIRST_TOLD:
            continue
        gone = _numbers_of(old) - _numbers_of(new)
        goes = "".join(f"; version {number} is deleted, which nothing refers to" for number in sorted(gone))
        yield f"{source.name} has {len(new.versions)} of at most {VERSIONS_AT_MOST} versions{goes}"


def _numbers_of(application: Application | None) -> set[int]:
    return {version.number for version in application.versions} if application else set()


def _of_members(store: Store) -> frozenset[str]:
    """Returns the digests that fleets and robots name."""
    keys = [*store.keys("robots/"), *store.keys("fleets/")]
    return frozenset[str]().union(*(digests_in(store.get(key).body.decode(errors="replace")) for key in keys))


def _of_jobs(store: Store) -> frozenset[str]:
    """Returns the digests that jobs name which have not ended, and the last deployments of each fleet."""
    found = [record for kind in JOB_KINDS for record in records(store, kind) if not is_terminal(record)]
    last: dict[str, list[JobRecord]] = {}
    for record in records(store, "deployment-job"):
        if record.status == "Succeeded":
            last.setdefault(str(record.request.get("fleet")), []).append(record)
    found += [record for each in last.values() for record in each[-_KEPT_DEPLOYMENTS:]]
    return frozenset[str]().union(*(digests_in(encode_document(record).decode()) for record in found))


def _of_gates(runs: Iterable[JobRecord]) -> frozenset[str]:
    """Returns the digests of the versions that gates of runs compared with."""
    pins = (run.request.get("pins") for run in runs)
    return frozenset(str(found.get("comparedWith", "")) for found in pins if isinstance(found, dict))


def _numbers(document: JsonValue) -> Iterator[str]:
    """Yields the version numbers that stand anywhere in a document."""
    if isinstance(document, list):
        for each in document:
            yield from _numbers(each)
    elif isinstance(document, dict):
        for key, value in document.items():
            if key in _NAMES_VERSION:
                yield str(value)
            else:
                yield from _numbers(value)
