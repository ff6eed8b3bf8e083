"""What a gc does: the plan of what can go and why, and the removal of it.

The plan is computed and changes nothing. The removal looks again at each item before it goes.
"""

import logging
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from specs.errors import ObjectExists, ObjectNotFound
from tasks.housekeeping.named_objects import NamedByRecords
from tasks.housekeeping.object_kinds import (
    BUNDLES,
    CLAIMS,
    METADATA,
    NAMED_BY_OTHERS,
    NEEDS_PROOF,
    PROBES,
    RECORDS,
    SPENT,
    TOKENS,
    UNFINISHED,
    WORLDS,
    ObjectKind,
    StoredJob,
    kind_of_key,
)
from tasks.storage.base.keys import claim_key, job_key, result_key
from tasks.storage.base.store import Entry, Store, find_document
from tasks.storage.jobs.claim import Claim, ClaimRecord, hold_claim_unless_alive

GONE = "of jobs without a record"
FORGOTTEN = "of jobs that ended long ago and that nothing names"
_WHY = {
    **SPENT,
    BUNDLES: "that nothing names",
    PROBES: "of processes that were killed while they opened the store",
    METADATA: "that newer versions have replaced",
    UNFINISHED: "of processes that were killed",
}
_FIRST_SEEN = "that nothing names since this time; a later gc frees them"
_YOUNG = "younger than the grace"
_LOG = logging.getLogger(__name__)
_CLAIM_TTL_S = 15.0
_BUNDLES_AT_ONCE, _COPIED_BYTES = 32, 256 << 20


@dataclass(frozen=True)
class Item:
    """An object that can go, or that has to wait.

    Attributes:
        entry: As it was listed.
        what: Its kind.
        why: Why it can go, or why it waits.
    """

    entry: Entry
    what: str
    why: str


@dataclass(frozen=True)
class Leftover:
    """What a job has left that has no record any more, or whose record is to be forgotten; all of it goes together.

    Attributes:
        job: Whose.
        record: Its record, which goes first.
        items: What it left, without record, token and claim.
        ends: Its token and claim, which go last, and only when all else is gone: they show that the rest was made here.
    """

    job: StoredJob
    record: Item | None
    items: tuple[Item, ...]
    ends: tuple[Item, ...]

    @property
    def all(self) -> tuple[Item, ...]:
        """All that goes, in the order in which it goes."""
        return (*((self.record,) if self.record else ()), *self.items, *self.ends)


@dataclass(frozen=True)
class SweepPlan:
    """What can go now.

    Attributes:
        single: What is removed one by one: left by killed processes, or replaced, or parts of exports that are done.
        bundles: Bundles.
        leftovers: What jobs have left, job by job.
        waiting: What nobody names and is too young, or was seen so for the first time.
        unnamed: Bundles that nobody names, with their marks and since when that is known; for the next time.
    """

    single: tuple[Item, ...] = ()
    bundles: tuple[Item, ...] = ()
    leftovers: tuple[Leftover, ...] = ()
    waiting: tuple[Item, ...] = ()
    unnamed: Mapping[str, tuple[str, float]] = field(default_factory=dict[str, tuple[str, float]])

    @property
    def items(self) -> tuple[Item, ...]:
        """All that can go now."""
        left = (item for leftover in self.leftovers for item in leftover.all)
        return (*self.single, *self.bundles, *left)


@dataclass(frozen=True)
class StoreListing:
    """What a store holds.

    Attributes:
        entries: All of it.
        unfinished: Writes that have not come to their end.
        token_jobs: Jobs of the tokens that belong to no record, by key.
        replaced: Keys of signed metadata that newer versions have replaced, for longer than the grace.
        now_s: The time, by the store's clock.
    """

    entries: Sequence[Entry]
    unfinished: Sequence[Entry]
    token_jobs: Mapping[str, StoredJob]
    replaced: frozenset[str]
    now_s: float


def plan_sweep(
    listing: StoreListing, named: NamedByRecords, noted: Mapping[str, tuple[str, float]], grace_s: float
) -> SweepPlan:
    """Returns what can go.

    Args:
        listing: What the store holds; records must have been read after it was taken.
        named: What they name.
        noted: ``Plan.unnamed`` of the last time.
        grace_s: So long nobody must have written a thing, nor named a bundle.
    """
    return _Planning(listing, named, noted, grace_s).plan()


class _Planning:
    def __init__(
        self, listing: StoreListing, named: NamedByRecords, noted: Mapping[str, tuple[str, float]], grace_s: float
    ) -> None:
        self._listing, self._named, self._noted, self._grace_s = listing, named, noted, grace_s
        self._placed = [(entry, self._place(entry)) for entry in listing.entries]
        self._unnamed: dict[str, tuple[str, float]] = {}
        self._waiting: list[Item] = []

    def plan(self) -> SweepPlan:
        unfinished = [Item(entry, UNFINISHED, _WHY[UNFINISHED]) for entry in self._listing.unfinished]
        single = self._old([*unfinished, *self._loose()])
        bundles, leftovers = self._bundles(), self._leftovers()
        return SweepPlan(tuple(single), tuple(bundles), tuple(leftovers), tuple(self._waiting), self._unnamed)

    def _place(self, entry: Entry) -> ObjectKind:
        place = kind_of_key(entry.key)
        return ObjectKind(TOKENS, self._listing.token_jobs.get(entry.key)) if place.what == TOKENS else place

    def _loose(self) -> Iterable[Item]:
        for entry, place in self._placed:
            done = place.what in SPENT and place.job is not None and self._named.jobs.get(place.job, False)
            replaced = place.what == METADATA and entry.key in self._listing.replaced
            if done or replaced or place.what == PROBES:
                yield Item(entry, place.what, _WHY[place.what])

    def _bundles(self) -> list[Item]:
        if BUNDLES in self._named.kept:
            return []
        found = [entry for entry, place in self._placed if place.what == BUNDLES and not self._is_named(entry)]
        return [item for item in self._old(Item(entry, BUNDLES, _WHY[BUNDLES]) for entry in found) if self._known(item)]

    def _is_named(self, bundle: Entry) -> bool:
        return bundle.key.rpartition("/")[2] in self._named.digests

    def _known(self, item: Item) -> bool:
        """Returns whether a bundle has had no name for the grace; if it is new to be without, it waits."""
        entry, now_s = item.entry, self._listing.now_s
        mark, since_s = self._noted.get(entry.key, ("", now_s))
        since_s = since_s if mark == entry.mark else now_s
        self._unnamed[entry.key] = (entry.mark, since_s)
        if now_s - since_s >= self._grace_s:
            return True
        self._waiting.append(Item(entry, BUNDLES, _FIRST_SEEN))
        return False

    def _leftovers(self) -> Iterable[Leftover]:
        by_job: defaultdict[StoredJob, list[tuple[Entry, str]]] = defaultdict(list)
        for entry, place in self._placed:
            if place.job and place.job not in self._named.jobs:
                by_job[place.job].append((entry, place.what))
        for job in sorted(by_job, key=lambda each: each.id):
            if leftover := self._leftover(job, by_job[job]):
                yield leftover

    def _leftover(self, job: StoredJob, placed: list[tuple[Entry, str]]) -> Leftover | None:
        why = FORGOTTEN if job in self._named.forgotten else GONE
        made_here = any(what in {TOKENS, CLAIMS, RECORDS} for _, what in placed)
        items = [Item(entry, what, why) for entry, what in placed if made_here or what not in NEEDS_PROOF]
        stay = self._named.kept | (NAMED_BY_OTHERS if job.id in self._named.ids else frozenset[str]())
        going = [item for item in items if item.what not in stay]
        # A claim that is held is looked at when its turn comes; one that a killed gc has left says nothing of the rest.
        if any(self._is_young(item.entry) for item in going if item.what != CLAIMS or len(going) == 1):
            self._waiting += [Item(item.entry, item.what, _YOUNG) for item in going]
            return None
        ends = [item for item in going if item.what in {TOKENS, CLAIMS}] if len(going) == len(items) else []
        rest = [item for item in going if item.what not in {TOKENS, CLAIMS, RECORDS}]
        record = next((item for item in going if item.what == RECORDS), None)
        return Leftover(job, record, tuple(rest), tuple(ends)) if going else None

    def _old(self, items: Iterable[Item]) -> list[Item]:
        """Returns those that are old enough; the others wait."""
        found = list(items)
        self._waiting += [Item(each.entry, each.what, _YOUNG) for each in found if self._is_young(each.entry)]
        return [item for item in found if not self._is_young(item.entry)]

    def _is_young(self, entry: Entry) -> bool:
        return self._listing.now_s - entry.written_s < self._grace_s


LookAgain = Callable[[], NamedByRecords]


# What a job has left is removed under the job's own claim, so that nobody begins the job anew meanwhile and takes
# what is about to go for what is there. After a gc was killed anywhere, the next one goes on: what shows whose a
# thing is goes last.
@dataclass
class SweepResult:
    """What came of a plan.

    Attributes:
        freed: What is gone.
        stayed: What somebody has written, named or begun to work on since it was listed.
    """

    freed: list[Item] = field(default_factory=list[Item])
    stayed: list[Item] = field(default_factory=list[Item])

    def note(self, item: Item, *, is_gone: bool) -> None:
        """Notes what became of an object."""
        (self.freed if is_gone else self.stayed).append(item)


def remove_planned(store: Store, plan: SweepPlan, look_again: LookAgain) -> SweepResult:
    """Returns what was removed, and what was not because it is in use by now.

    Args:
        store: What the plan is for.
        plan: What can go.
        look_again: Returns what the store's records name at that moment.
    """
    swept = SweepResult()
    for item in plan.single:
        swept.note(item, is_gone=_remove(store, item))
    for leftover in plan.leftovers:
        _sweep_leftover(store, leftover, look_again, swept)
    for few in _few_at_a_time(plan.bundles):
        _sweep_bundles(store, few, look_again, swept)
    return swept


def _remove(store: Store, item: Item) -> bool:
    if item.what == UNFINISHED:
        store.discard(item.entry)
        return True
    return store.delete_unchanged(item.entry)


def _sweep_leftover(store: Store, leftover: Leftover, look_again: LookAgain, swept: SweepResult) -> None:
    job = leftover.job
    key = claim_key(job.kind, job.id)
    with hold_claim_unless_alive(store, key, ttl_s=_CLAIM_TTL_S) as claim:
        if claim is None or not _is_left(store, leftover, look_again):
            _LOG.info("%s is in use again; what it has left stays", job.id)
            swept.stayed += leftover.all
            return
        if leftover.record:
            swept.note(leftover.record, is_gone=True)
        if not _remove_items(store, leftover.items, claim, swept):
            swept.stayed += leftover.ends
            return
        for item in leftover.ends:
            if item.what == TOKENS:
                swept.note(item, is_gone=_remove_token(store, job, item))
    _drop_claim(store, key, claim.epoch)
    for item in leftover.ends:
        if item.what != TOKENS:
            swept.note(item, is_gone=True)


def _remove_items(store: Store, items: Sequence[Item], claim: Claim, swept: SweepResult) -> bool:
    """Removes what a job left; returns whether all of it is gone.

    A gc that slept may have been replaced by who made the job anew: what that one wrote stays.
    """
    are_gone = True
    for item in items:
        is_gone = not claim.lost and store.delete_unchanged(item.entry)
        are_gone = are_gone and is_gone
        swept.note(item, is_gone=is_gone)
    return are_gone


def _is_left(store: Store, leftover: Leftover, look_again: LookAgain) -> bool:
    """Returns whether the job has no record (now), and nobody names what is to go."""
    job, kinds = leftover.job, {item.what for item in leftover.items}
    if leftover.record:
        named = look_again()
        if job.id in named.ids or named.spoilt:
            return False
        if not store.delete_unchanged(leftover.record.entry):
            return False
    elif store.exists(job_key(job.kind, job.id)):
        return False
    if not kinds & NAMED_BY_OTHERS:
        return True
    if WORLDS not in kinds:  # a batch's files, which only its evidence names, and an export's
        return not store.exists(result_key(job.id, "evidence.json"))
    named = look_again()
    return job.id not in named.ids and not kinds & named.kept


def _remove_token(store: Store, job: StoredJob, item: Item) -> bool:
    """Removes the token of a job; who submits the job at this moment, relying on the token, gets it back."""
    try:
        body = store.get(item.entry.key).body
    except ObjectNotFound:
        return True
    if not store.delete_unchanged(item.entry):
        return False
    if not store.exists(job_key(job.kind, job.id)):
        return True
    try:
        store.create(item.entry.key, body)
    except ObjectExists:  # the submitter wrote it anew
        return False
    return False


def _drop_claim(store: Store, key: str, epoch: int) -> None:
    """Removes a claim that nobody has taken since; who comes with an older epoch than a record's may not write it."""
    try:
        entry = store.entry(key)
    except ObjectNotFound:
        return
    found = find_document(store, key, ClaimRecord)
    if (
        found and found.released and found.epoch == epoch
    ):  # if somebody took it after this look, it has changed, and stays
        store.delete_unchanged(entry)


def _few_at_a_time(bundles: Sequence[Item]) -> Iterator[list[Item]]:
    """Yields bundles some at a time: to look again costs requests, and copies of what is removed take room."""
    few: list[Item] = []
    for item in bundles:
        few.append(item)
        if len(few) == _BUNDLES_AT_ONCE or sum(each.entry.size_bytes for each in few) > _COPIED_BYTES:
            yield few
            few = []
    if few:
        yield few


def _sweep_bundles(store: Store, bundles: Sequence[Item], look_again: LookAgain, swept: SweepResult) -> None:
    """Removes bundles, unless they are named or were written again; those named right afterwards are put back.

    Only where a store cannot remove and compare in one step can another process have published the same bytes, and
    named them, between the look and the removal.
    """
    before = look_again()
    with tempfile.TemporaryDirectory(prefix="simyard-gc-") as folder:
        gone: list[Item] = []
        for item in bundles:
            removed = _is_unnamed(item, before) and _remove_bundle(store, item, Path(folder))
            (gone if removed else swept.stayed).append(item)
        after = look_again() if gone else before
        for item in gone:
            is_named = not _is_unnamed(item, after)
            if is_named and (copy := Path(folder) / _digest(item)).exists():
                store.upload(item.entry.key, copy)
            swept.note(item, is_gone=not is_named)


def _remove_bundle(store: Store, item: Item, folder: Path) -> bool:
    try:
        store.download(item.entry.key, folder / _digest(item))
    except ObjectNotFound:  # another gc was faster
        return True
    return store.delete_unchanged(item.entry)


def _digest(bundle: Item) -> str:
    return bundle.entry.key.rpartition("/")[2]


def _is_unnamed(bundle: Item, named: NamedByRecords) -> bool:
    return _digest(bundle) not in named.digests and BUNDLES not in named.kept
