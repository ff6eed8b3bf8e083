"""Removes what a plan names, and looks again right before each removal.

What a job has left is removed under the job's own claim, so that nobody begins the job anew meanwhile and takes what is
about to go for what is there. After a gc was killed anywhere, the next one goes on: what shows whose a thing is goes
last.
"""

import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from specs.errors import ObjectExists, ObjectNotFound
from tasks.housekeeping.line_sweep import mark_job, sweep_lines
from tasks.housekeeping.object_kinds import BUNDLES, NAMED_BY_OTHERS, TOKENS, UNFINISHED, WORLDS, Job
from tasks.housekeeping.references import NamedByRecords
from tasks.housekeeping.sweep_plan import Item, Leftover, SweepPlan
from tasks.storage.base.encoding import decode_document
from tasks.storage.base.keys import claim_key, job_key, result_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, ClaimRecord, hold_claim_unless_alive

_LOG = logging.getLogger(__name__)
_CLAIM_TTL_S = 15.0
_BUNDLES_AT_ONCE, _COPIED_BYTES = 32, 256 << 20
LookAgain = Callable[[], NamedByRecords]


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


def sweep(store: Store, plan: SweepPlan, look_again: LookAgain) -> SweepResult:
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
    sweep_lines(store, [leftover.job for leftover in plan.leftovers if leftover.record or leftover.marks])
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
        mark_job(store, job)
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


def _remove_token(store: Store, job: Job, item: Item) -> bool:
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
        found = decode_document(ClaimRecord, store.get(key), store, key)
    except ObjectNotFound:
        return
    if found.released and found.epoch == epoch:  # if somebody took it after this look, it has changed, and stays
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
