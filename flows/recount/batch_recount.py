"""Counts a batch again: every chunk is vouched for or simulated anew, tables and counts are made from the chunks.

Whoever may write to the store may change every record in it. So nothing here believes the batch's record: the plan is
the one that the document gives now, and what the record says is only compared (docs/decisions/0010).
"""

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, cast

from pydantic import JsonValue

from flows.batch.batch_end import with_audit
from flows.batch.early_end import EarlyEnd
from flows.batch.recorded_episodes import RecordedEpisodes
from flows.batch.replay_episode import bundles
from specs.digest import without_absent
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate, stops_early
from tasks.results.tables.table_record import recounted_facts
from tasks.simulate.audit.audit_run import AUDIT_FILE, audit_again
from tasks.simulate.batch.chunk_runner import ChunkRunner
from tasks.simulate.batch.commit import run_chunk
from tasks.simulate.batch.job import KIND, OpenBatch, load_batch, require_plan
from tasks.simulate.batch.prepared_chunks import forget_chunks
from tasks.simulate.batch.provenance import SEALED, batch_metadata, facts_of, is_sealed, with_facts
from tasks.simulate.batch.result_stream import result_parts
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord

_RAN_ON = frozenset({"engine", "device"})
_SHOWN = 200


class BatchRecount(NamedTuple):
    """A batch that was counted again.

    Attributes:
        batch: The batch, with the plan that the document gives.
        record: Its record, saying what was computed.
        changes: What the record in the store says instead, one line each.
        bundles: Unpacked folders of its applications, by digest.
    """

    batch: OpenBatch
    record: JobRecord
    changes: list[str]
    bundles: Mapping[str, Path]


class Planned(NamedTuple):
    """What the document asks for now: the batch's plan, and where its files go."""

    plan: BatchPlan
    location: OutputLocation


def vouched_record(record: JobRecord, store: Store, gate: Gate, planned: Callable[[], Planned]) -> JobRecord:
    """Returns the record of a batch that Completed, with nothing in it to be judged by but what its owner vouches for.

    If the owner does not vouch for the record, because another machine wrote it or because somebody changed it, the
    batch is counted again.

    Args:
        record: As it was read from the store.
        store: Where the batch is.
        gate: The document's gate.
        planned: Gives what the document asks for now.

    Raises:
        StageFailed: The batch is not what its record says.
    """
    batch = load_batch(store, record.id)
    if is_sealed(record, batch.voucher):
        return with_facts(record, batch.plan, facts_of(record.detail))
    found = count_batch(record, store, gate, planned())
    if found.changes:
        raise StageFailed("MismatchedEtag", "; ".join(found.changes), record.arn)
    return found.record


def count_batch(record: JobRecord, store: Store, gate: Gate, planned: Planned) -> BatchRecount:
    """Returns a batch that Completed, counted again from its chunks.

    A chunk that its owner does not vouch for is simulated anew, and is vouched for from then on if nothing differs.

    Args:
        record: As it was read from the store.
        store: Where the batch is.
        gate: The document's gate.
        planned: What the document asks for.

    Raises:
        StageFailed: The record says another plan, or a chunk is not what the simulation gives.
    """
    plan = planned.plan
    batch = require_plan(store, record.id, plan)
    folders, sealed = bundles(batch), is_sealed(record, batch.voucher)
    early = _commit_vouched(batch, folders, gate, planned.location)
    if sealed:  # by the gate of the run that drove it, which may not be this one
        early = {name: fact for name, fact in record.detail.items() if name == "stopped_early"}
    facts = recounted_facts(
        batch.id,
        result_parts(batch, record.status),
        variables=plan.variables(),
        metadata=_metadata(record, plan, sealed=sealed),
    )
    facts = with_audit({**facts, **early}, _audit(batch, folders, record, sealed=sealed))
    changes = list(_changes(f"{store.url}/{job_key(KIND, record.id)}", record.detail, facts))
    return BatchRecount(batch, with_facts(record, plan, facts), changes, folders)


def _commit_vouched(
    batch: OpenBatch, folders: Mapping[str, Path], gate: Gate, location: OutputLocation
) -> dict[str, JsonValue]:
    """Lets each chunk be one that is vouched for; returns why the batch ended early, if its gate is sure of it."""
    recordings = RecordedEpisodes(batch, location, folders).write
    runner = ChunkRunner(folders, batch.plan.engine, batch.plan.recordings.rateHz, lambda _: None)
    early, lanes = EarlyEnd(batch, gate if stops_early(gate) else None), batch.plan.lanes
    try:
        for number in range(batch.layout.chunks):
            if early.ends_before(number):
                break
            written = recordings if batch.plan.records() else None
            lanes = run_chunk(batch, number, runner.run, written, lanes=lanes, left_s=math.inf).lanes
    finally:
        forget_chunks(batch)
    return early.detail


def _metadata(record: JobRecord, plan: BatchPlan, *, sealed: bool) -> dict[str, str]:
    """Returns what the tables' footers say of versions: those that the owner vouches for, or those of this process."""
    if not sealed:
        return batch_metadata(plan.lanes)
    said = cast("dict[str, str]", record.detail["metadata"])
    return {name: value for name, value in said.items() if name not in _RAN_ON}


def _audit(
    batch: OpenBatch, folders: Mapping[str, Path], record: JobRecord, *, sealed: bool
) -> Mapping[str, JsonValue]:
    """Returns what the record has to say of the audit: it is made anew where the owner does not vouch for it."""
    if not sealed:
        return audit_again(batch, folders) if min(batch.plan.audit, batch.layout.episodes) else {}
    digests = cast("dict[str, JsonValue]", record.detail["sha256s"])
    audited: dict[str, JsonValue] = {name: digests[name] for name in (AUDIT_FILE,) if name in digests}
    return {"audit": record.detail["audit"], "sha256s": audited} if audited else {}


def _changes(key: str, said: Mapping[str, JsonValue], facts: Mapping[str, JsonValue]) -> Iterator[str]:
    for name in SEALED:
        # A gate's fields that are null are none: an older version may not have had them.
        if without_absent(said.get(name)) != without_absent(facts.get(name)):
            yield f"{key} says {name} {_short(said.get(name))}; computed: {_short(facts.get(name))}"


def _short(value: JsonValue) -> str:
    return repr(value)[:_SHOWN]
