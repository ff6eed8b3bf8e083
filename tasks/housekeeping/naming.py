"""What the records of a store name, taken together."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from tasks.housekeeping.layout import BUNDLES, NAMED_BY_OTHERS, RECORDS, Job, place_of
from tasks.housekeeping.reading import Record, Records

# Runs of a document are numbered without gaps, and each says how it went; nothing is gained by forgetting one.
_NEVER_FORGOTTEN = "pipeline-run"


@dataclass(frozen=True)
class Spoilt:
    """A record that cannot be read, and what therefore stays.

    Attributes:
        key: The record's.
        why: What is wrong with it.
        keeps: Kinds of objects that it might name.
    """

    key: str
    why: str
    keeps: frozenset[str]


@dataclass(frozen=True)
class Named:
    """What is named.

    Attributes:
        jobs: Those with a record, and whether they have ended; of one whose record is spoilt that is not believed.
        forgotten: Keys of the records of those that ended long ago, and that nobody names.
        ids: Jobs that others than themselves name.
        digests: SHA-256 digests.
        tokens: Keys of the tokens of jobs with a record.
        spoilt: Records that cannot be read.
    """

    jobs: dict[Job, bool] = field(default_factory=dict[Job, bool])
    forgotten: dict[Job, Record] = field(default_factory=dict[Job, Record])
    ids: frozenset[str] = frozenset()
    digests: frozenset[str] = frozenset()
    tokens: frozenset[str] = frozenset()
    spoilt: tuple[Spoilt, ...] = ()

    @property
    def kept(self) -> frozenset[str]:
        """Kinds of objects of which nothing is freed, because a record that cannot be read may name them."""
        return frozenset[str]().union(*(each.keeps for each in self.spoilt))


def named(records: Records, ended_before_s: float | None = None) -> Named:
    """Returns what records name.

    Args:
        records: All of a store, by key.
        ended_before_s: Jobs that ended before it, by the store's clock, and that nobody names, count as forgotten; None
            for none.
    """
    unread = any(record.spoilt for record in records.values())  # it may name any job
    forgotten = {} if unread or ended_before_s is None else _forgotten(records, ended_before_s)
    left = [record for key, record in records.items() if key not in forgotten]
    facts = [record.job for record in left if record.job]
    return Named(
        jobs={**_unread(left), **{each.job: each.ended for each in facts}},
        forgotten={record.job.job: record for record in forgotten.values() if record.job},
        ids=_ids(left),
        digests=frozenset[str]().union(*(record.digests for record in left)),
        tokens=frozenset(each.token for each in facts),
        spoilt=tuple(_spoilt(record) for record in left if record.spoilt),
    )


def _unread(records: Iterable[Record]) -> dict[Job, bool]:
    """Returns the jobs whose records cannot be read: they are there, and may be under way."""
    places = (place_of(record.entry.key) for record in records if record.spoilt)
    return {place.job: False for place in places if place.job and place.what == RECORDS}


def _ids(records: Iterable[Record]) -> frozenset[str]:
    """Returns the jobs that others name; an ended run of a document only tells of them, and needs them no more."""
    return frozenset[str]().union(*(record.ids for record in records if not _is_ended_run(record)))


def _is_ended_run(record: Record) -> bool:
    return record.job is not None and record.job.ended and record.job.job.kind == _NEVER_FORGOTTEN


def _forgotten(records: Records, before_s: float) -> dict[str, Record]:
    """Returns the records of jobs that ended long ago and that no other record names, by key."""
    found = {key: record for key, record in records.items() if _ended_before(record, before_s)}
    while True:
        ids = _ids(record for key, record in records.items() if key not in found)
        left = {key: record for key, record in found.items() if record.job and record.job.job.id not in ids}
        if len(left) == len(found):
            return left
        found = left


def _ended_before(record: Record, before_s: float) -> bool:
    # The record of a job that has ended is never written again, so it is as old as the end.
    facts = record.job
    return bool(facts and facts.ended and facts.job.kind != _NEVER_FORGOTTEN and record.entry.written_s < before_s)


def _spoilt(record: Record) -> Spoilt:
    keeps = frozenset({BUNDLES}) if record.entry.key.startswith(("robots/", "fleets/")) else NAMED_BY_OTHERS
    return Spoilt(record.entry.key, record.spoilt, keeps)
