"""Finds the version that a gate compares with, and the batch that drove it on the same episodes."""

from collections.abc import Hashable, Iterable, Iterator
from typing import NamedTuple, cast

from flows.batch.world_identity import world_identities
from flows.pipeline.tested_batch import candidates
from specs.errors import BucketNotFound, ResourceNotFound
from specs.pipeline.gate_section import NoWorseThan
from specs.settings import OWNER_KEY
from tasks.applications.registry import resolve
from tasks.results.gate.evidence import Baseline
from tasks.results.gate.version_pairs import PAIRED_COLUMNS, Drive, both_ended, drives
from tasks.results.tables.result_files import RESULTS_FILE, stored_rows
from tasks.simulate.batch.batch_record import KIND, load_batch, plan_of
from tasks.simulate.batch.provenance import facts_of, is_sealed, with_facts
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read, records


class NoBaseline(NamedTuple):
    """There is nothing to compare with, and why, for a person."""

    why: str


def find_baseline(rule: NoWorseThan, batch: JobRecord, store: Store) -> Baseline | NoBaseline:
    """Returns the batch that drove the other version: this one itself, else the newest that ended with the same worlds.

    Args:
        rule: Names the version.
        batch: The batch that is judged.
        store: Where versions and batches are.

    Raises:
        ResourceNotFound: There is no such version.
        StageFailed: The results of a batch that would do are not what it wrote.
    """
    plan = plan_of(batch)
    names = sorted({template.robot.name for template in plan.templates})
    if len(names) != 1:
        return NoBaseline(f"the batch tests several applications ({', '.join(names)}), and the rule means one")
    digest = resolve(store, "robot-application", names[0], rule.applicationVersion).digest
    if len(candidates(plan, digest)) != 1:
        return NoBaseline(f"the batch tests several versions of {names[0]} besides version {rule.applicationVersion}")
    for record in _may_have_driven(digest, batch, store):
        if _same_episodes(digest, batch, record, store):
            return Baseline(
                version=rule.applicationVersion, digest=digest, batch=record.id, sha256=results_digest(record)
            )
    version = f"version {rule.applicationVersion} of {names[0]} ({digest[:12]})"
    if foreign := _sealed_elsewhere(digest, batch, store):
        return NoBaseline(
            f"batch {foreign} drove {version}, but this machine's key does not vouch for it; bring the "
            f"owner's key of the machine that ran it (its cache's owner/key), and name the file in {OWNER_KEY}, "
            "or put both versions into createSimulationJobRequests"
        )
    return NoBaseline(
        f"no batch that Completed drove {version} on the same episodes, and is vouched for by this owner; put both "
        "versions into createSimulationJobRequests"
    )


def read_drives(store: Store, record: JobRecord, digests: Iterable[str]) -> dict[Hashable, Drive]:
    """Returns what a batch's episodes came to, by what was asked of them but for the robot application.

    Args:
        store: Where the batch is.
        record: A batch that ended.
        digests: Robot applications whose episodes are meant.

    Raises:
        ResourceNotFound: Its results are gone.
        StageFailed: They are not what it wrote.
    """
    place, written = recorded_location(record), results_digest(record)
    rows = stored_rows(store, place, record.id, RESULTS_FILE, sha256=written, columns=PAIRED_COLUMNS)
    return drives(rows, world_identities(store, plan_of(record).worlds_used()), digests)


def sealed_record(store: Store, batch: str) -> JobRecord | None:
    """Returns the record of a batch that its owner vouches for, or None; there may be no such batch."""
    try:
        record = read(store, KIND, batch)
    except ResourceNotFound:
        return None
    opened = load_batch(store, batch)
    return with_facts(record, opened.plan, facts_of(record.detail)) if is_sealed(record, opened.authenticator) else None


def _may_have_driven(digest: str, batch: JobRecord, store: Store) -> Iterator[JobRecord]:
    """Yields the batch itself if it has the version, else others that have it and are vouched for, newest first."""
    if _drove(batch, digest):
        yield batch
        return
    for record in reversed(records(store, KIND)):
        if record.id != batch.id and record.status == "Completed" and _drove(record, digest):
            vouched = sealed_record(store, record.id)
            if vouched is not None:
                yield vouched


def _sealed_elsewhere(digest: str, batch: JobRecord, store: Store) -> str:
    """Returns the newest batch that drove a version on this one's seeds without this owner's seal, or nothing."""
    seeds = set(plan_of(batch).seeds_used())
    for record in reversed(records(store, KIND)):
        if record.id == batch.id or record.status != "Completed" or not _drove(record, digest):
            continue
        if seeds & set(plan_of(record).seeds_used()) and sealed_record(store, record.id) is None:
            return record.id
    return ""


def _drove(record: JobRecord, digest: str) -> bool:
    return any(template.robot.digest == digest for template in plan_of(record).templates)


def _same_episodes(digest: str, batch: JobRecord, record: JobRecord, store: Store) -> bool:
    if record.id == batch.id:
        return True
    plan, other = plan_of(batch), plan_of(record)
    if not set(plan.seeds_used()) & set(other.seeds_used()):  # there is no need to look into worlds and rows
        return False
    try:
        theirs = read_drives(store, record, [digest])
    except (ResourceNotFound, BucketNotFound):  # somebody cleared old results away
        return False
    return both_ended(read_drives(store, batch, candidates(plan, digest)), theirs)


def results_digest(record: JobRecord) -> str:
    """Returns the SHA-256 of a batch's results, as its record says."""
    return cast("dict[str, str]", record.detail["sha256s"])[RESULTS_FILE]
