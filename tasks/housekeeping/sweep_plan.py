"""The plan of a gc: what can go, what waits until it is older, and why. It is computed and changes nothing."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tasks.housekeeping.object_kinds import (
    BUNDLES,
    CLAIMS,
    LINE_MARKS,
    METADATA,
    NAMED_BY_OTHERS,
    NEEDS_PROOF,
    PROBES,
    RECORDS,
    SEGMENTS,
    SPENT,
    TOKENS,
    UNFINISHED,
    Job,
    ObjectKind,
    kind_of_key,
)
from tasks.housekeeping.references import NamedByRecords
from tasks.storage.base.store import Entry

GONE = "of jobs without a record"
FORGOTTEN = "of jobs that ended long ago and that nothing names"
_WHY = {
    **SPENT,
    BUNDLES: "that nothing names",
    PROBES: "of processes that were killed while they opened the store",
    METADATA: "that newer versions have replaced",
    SEGMENTS: "of processes that were killed while they listed jobs",
    UNFINISHED: "of processes that were killed",
}
_FIRST_SEEN = "that nothing names since this time; a later gc frees them"
_YOUNG = "younger than the grace"


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
        marks: That it has no line, or had none; they go after the lines of all that went.
    """

    job: Job
    record: Item | None
    items: tuple[Item, ...]
    ends: tuple[Item, ...]
    marks: tuple[Item, ...] = ()

    @property
    def all(self) -> tuple[Item, ...]:
        """All that goes and is told of, in the order in which it goes; a mark is a name without bytes."""
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
        replaced: Keys of signed metadata that newer versions have replaced, for longer than the grace, and of lines of
            jobs that no root names.
        now_s: The time, by the store's clock.
    """

    entries: Sequence[Entry]
    unfinished: Sequence[Entry]
    token_jobs: Mapping[str, Job]
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
            replaced = place.what in {METADATA, SEGMENTS} and entry.key in self._listing.replaced
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
        by_job: defaultdict[Job, list[tuple[Entry, str]]] = defaultdict(list)
        for entry, place in self._placed:
            if place.job and place.job not in self._named.jobs:
                by_job[place.job].append((entry, place.what))
        for job in sorted(by_job, key=lambda each: each.id):
            if leftover := self._leftover(job, by_job[job]):
                yield leftover

    def _leftover(self, job: Job, placed: list[tuple[Entry, str]]) -> Leftover | None:
        why = FORGOTTEN if job in self._named.forgotten else GONE
        made_here = any(what in {TOKENS, CLAIMS, RECORDS} for _, what in placed)
        items = [Item(entry, what, why) for entry, what in placed if made_here or what not in NEEDS_PROOF]
        stay = self._named.kept | (NAMED_BY_OTHERS if job.id in self._named.ids else frozenset[str]())
        going = [item for item in items if item.what not in stay]
        # A claim that is held is looked at when its turn comes; one that a killed gc has left says nothing of the rest.
        if any(self._is_young(item.entry) for item in going if item.what != CLAIMS or len(going) == 1):
            told = [item for item in going if item.what != LINE_MARKS]  # a mark goes with its record, unsaid
            self._waiting += [Item(item.entry, item.what, _YOUNG) for item in told]
            return None
        ends = [item for item in going if item.what in {TOKENS, CLAIMS}] if len(going) == len(items) else []
        rest = [item for item in going if item.what not in {TOKENS, CLAIMS, RECORDS, LINE_MARKS}]
        record = next((item for item in going if item.what == RECORDS), None)
        marks = tuple(item for item in going if item.what == LINE_MARKS)
        return Leftover(job, record, tuple(rest), tuple(ends), marks) if going else None

    def _old(self, items: Iterable[Item]) -> list[Item]:
        """Returns those that are old enough; the others wait."""
        found = list(items)
        self._waiting += [Item(each.entry, each.what, _YOUNG) for each in found if self._is_young(each.entry)]
        return [item for item in found if not self._is_young(item.entry)]

    def _is_young(self, entry: Entry) -> bool:
        return self._listing.now_s - entry.written_s < self._grace_s
