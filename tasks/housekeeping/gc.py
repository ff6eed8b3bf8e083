"""A gc of a store and of this machine's cache: it marks, reports, and removes if that is wanted."""

import logging
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, ValidationError

from specs.base import Spec
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, StoreError
from tasks.housekeeping.machine import CacheEntry, remove_entry, unused_entries
from tasks.housekeeping.named_objects import (
    NamedByRecords,
    Records,
    names_in,
    read_records,
    record_entries,
    replaced_metadata,
)
from tasks.housekeeping.object_kinds import TOKENS, StoredJob, job_of_id, kind_of_key
from tasks.housekeeping.sweep import Item, StoreListing, SweepPlan, SweepResult, plan_sweep, remove_planned
from tasks.storage.base.keys import UNNAMED
from tasks.storage.base.store import Entry, Store, encode_document
from tasks.storage.buckets import bucket_url

_LOG = logging.getLogger(__name__)
_AT_ONCE = 16
_ANY_BUCKET = "any-bucket"


class FindingRow(Spec):
    """Objects of one kind that go, or stay, for one reason.

    Attributes:
        kind: Such as ``bundles``.
        objects: How many.
        bytes: Of all of them.
        why: Such as ``that nothing names``.
    """

    kind: str
    objects: int
    bytes: int
    why: str


class UnreadRecord(Spec):
    """A record that cannot be read.

    Attributes:
        record: Its key.
        why: What is wrong with it.
        keeps: Kinds of objects that stay because it might name them.
    """

    record: str
    why: str
    keeps: tuple[str, ...]


class GcReport(Spec):
    """What can go, or went.

    Attributes:
        store: Its URL.
        removed: Whether it was removed, or only told.
        freed: What can go; what went, once it was removed.
        waiting: What nobody names and is too young yet.
        stayed: What was to go, and was used when its turn came.
        unread: Records that cannot be read.
        left_out: What was not looked at.
        cache: What of this machine's cache can go, or went.
    """

    store: str
    removed: bool
    freed: tuple[FindingRow, ...]
    waiting: tuple[FindingRow, ...]
    stayed: tuple[FindingRow, ...]
    unread: tuple[UnreadRecord, ...]
    left_out: tuple[str, ...]
    cache: tuple[FindingRow, ...]


@dataclass(frozen=True)
class Ages:
    """How old things must be.

    Attributes:
        grace_s: Since they were written, or were without a name, before they go.
        ended_s: Since jobs ended before they are forgotten; None to forget none.
        unused_s: Since what is in this machine's cache was used last.
    """

    grace_s: float = 24 * 3600.0
    ended_s: float | None = None
    unused_s: float = 30 * 24 * 3600.0


class _Token(Spec):
    token: str
    request_digest: str
    id: str


class _Unnamed(Spec):
    """Bundles without a name, with the mark that each had, and since when that is known by the store's clock."""

    bundles: dict[str, tuple[str, float]] = Field(default_factory=dict[str, tuple[str, float]])


def collect_garbage(store: Store, cache: Path, ages: Ages, *, remove: bool) -> GcReport:
    """Returns what nobody names any more, and removes it if that is wanted.

    Args:
        store: Which one.
        cache: This machine's folder of what can be made again.
        ages: How old things must be.
        remove: Whether to do it; else it is only told, and nothing is written.

    Raises:
        StoreError: The store fails; what was removed until then may be, and the next gc goes on.
    """
    marked = _Marked(store, ages)
    notes, etag = _notes(store)
    plan = plan_sweep(marked.listing, marked.named, notes.bundles, ages.grace_s)
    cached = unused_entries(cache, ages.unused_s)
    swept = SweepResult(freed=list(plan.items))
    if remove:
        _keep_notes(store, plan, etag)
        swept = remove_planned(store, plan, marked.look_again)
        cached = [entry for entry in cached if remove_entry(entry)]
    return _report(marked, plan, swept, cached, removed=remove)


class _Marked:
    """What a store holds, and what its records name: first listed, then read, so that what begins meanwhile counts."""

    def __init__(self, store: Store, ages: Ages) -> None:
        self._store, self.url, now_s = store, store.url, store.now_s()
        self._ended_before_s = None if ages.ended_s is None else now_s - ages.ended_s
        entries = store.entries("")
        self._records: Records = {}
        self.left_out = _left_out(store)
        self.named = self.look_again()
        self.listing = StoreListing(
            entries=entries,
            unfinished=self._unfinished(),
            token_jobs=_token_jobs(store, entries, self.named),
            replaced=replaced_metadata(store, entries, now_s - ages.grace_s),
            now_s=now_s,
        )

    def _unfinished(self) -> list[Entry]:
        try:
            return self._store.unfinished("")
        except StoreError as exc:  # to list them is a permission of its own, and not every server can
            self.left_out += (f"unfinished writes: {exc}",)
            return []

    def look_again(self) -> NamedByRecords:
        """Returns what the records name now; those that are as they were are not read again."""
        self._records = read_records(self._store, record_entries(self._store, self._records), self._records)
        return names_in(self._records, self._ended_before_s)


def _token_jobs(store: Store, entries: Iterable[Entry], known: NamedByRecords) -> dict[str, StoredJob]:
    """Returns the jobs of the tokens that belong to no record, by the tokens' keys."""
    keys = [each.key for each in entries if kind_of_key(each.key).what == TOKENS and each.key not in known.tokens]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        jobs = pool.map(lambda key: _token_job(store, key), keys)
        return {key: job for key, job in zip(keys, jobs, strict=True) if job}


def _token_job(store: Store, key: str) -> StoredJob | None:
    try:
        return job_of_id(_Token.model_validate_json(store.get(key).body).id)
    except ObjectNotFound:
        return None
    except (ValidationError, KeyError) as exc:
        _LOG.warning("%s: %s stays: it is no token (%s)", store.url, key, type(exc).__name__)
        return None


def _notes(store: Store) -> tuple[_Unnamed, str]:
    try:
        stored = store.get(UNNAMED)
    except ObjectNotFound:
        return _Unnamed(), ""
    try:
        return _Unnamed.model_validate_json(stored.body), stored.etag
    except ValidationError:  # as good as none: bundles wait once more
        return _Unnamed(), stored.etag


def _keep_notes(store: Store, plan: SweepPlan, etag: str) -> None:
    """Notes since when bundles have had no name, if anything is to be noted."""
    body = encode_document(_Unnamed(bundles=dict(plan.unnamed)))
    try:
        if etag:
            store.replace(UNNAMED, body, etag)
        elif plan.unnamed:
            store.create(UNNAMED, body)
    except (ObjectConflict, ObjectExists):
        _LOG.info("another gc has noted the bundles without a name")


def _report(
    marked: _Marked, plan: SweepPlan, swept: SweepResult, cached: Iterable[CacheEntry], *, removed: bool
) -> GcReport:
    spoilt = marked.named.spoilt
    return GcReport(
        store=marked.url,
        removed=removed,
        freed=_rows(swept.freed),
        waiting=_rows(plan.waiting),
        stayed=_rows(swept.stayed),
        unread=tuple(UnreadRecord(record=each.key, why=each.why, keeps=tuple(sorted(each.keeps))) for each in spoilt),
        left_out=marked.left_out,
        cache=_sum_rows(((entry.what, "that nobody has used for long"), entry.size_bytes) for entry in cached),
    )


def _left_out(store: Store) -> tuple[str, ...]:
    place = bucket_url(store, _ANY_BUCKET).removesuffix(f"/{_ANY_BUCKET}")
    if place == f"{store.url}/buckets":
        return ()
    return (f"{place}: buckets outside the store may be others' too; exports, tables and recordings there stay",)


def _rows(items: Iterable[Item]) -> tuple[FindingRow, ...]:
    return _sum_rows(((item.what, item.why), item.entry.size_bytes) for item in items)


def _sum_rows(sizes: Iterable[tuple[tuple[str, str], int]]) -> tuple[FindingRow, ...]:
    found: dict[tuple[str, str], list[int]] = {}
    for name, size in sizes:
        found.setdefault(name, []).append(size)
    return tuple(
        FindingRow(kind=kind, objects=len(each), bytes=sum(each), why=why)
        for (kind, why), each in sorted(found.items())
    )
