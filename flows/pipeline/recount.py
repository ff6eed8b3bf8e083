"""Recomputes, right before something is shipped, all that its gate has judged by: worlds, plan, rows, tables, verdict.

Whoever may write to the store may change every record in it. So nothing here believes the batch's record: the plan is
the one that the document gives now, every chunk is one that the owner authenticates or is simulated anew, and what the
record says is only compared (docs/decisions/0010).

A few episodes, drawn after the fact, are simulated again and compared bit for bit. Who forges a share f of the rows is
found by n episodes with probability 1 - (1 - f)^n: a tenth of them by 8 in 57 %, by 30 in 96 % of all cases. It is the
second line: no row is counted that the owner does not authenticate.
"""

import logging
import math
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from random import Random, SystemRandom
from typing import NamedTuple, cast

from pydantic import JsonValue

from flows.batch.batch_end import RecordedEpisodes, with_audit
from flows.batch.batch_steps import SequentialStop
from flows.batch.replay_episode import bundles
from flows.batch.search_batch import search_batch
from flows.pipeline.baselines import NoBaseline
from flows.pipeline.references import ParsedRun
from flows.pipeline.run_gate import GateAnswer, gate_material, read_baseline, read_gate_answer, tested_facts
from flows.pipeline.tested_batch import batch_plan, compared_digest
from specs.arn import arn
from specs.base import without_absent
from specs.data.episode import CANCELED, EpisodeResult
from specs.errors import DocumentError, StageFailed
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate, stops_early
from specs.pipeline.section_requests import generation_request, section_parts
from specs.pipeline.simulation_section import SimulationBatch
from specs.pipeline.world_sections import WorldGeneration
from specs.settings import RECOUNT
from specs.template.body import template_digest
from tasks.documents.template_source import find_template
from tasks.progress.listener import at_a_time
from tasks.results.gate.evidence import Baseline, Evidence, evidence_digest, gather
from tasks.results.gate.gate_verdict import judge
from tasks.results.tables.result_files import recounted_facts
from tasks.simulate.audit.audit_run import AUDIT_FILE, audit_again
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch, require_plan
from tasks.simulate.batch.chunk_run import ChunkRunner, forget_chunks, run_chunk
from tasks.simulate.batch.chunk_store import counted_chunk, row_changes
from tasks.simulate.batch.provenance import SEALED, batch_metadata, facts_of, is_sealed, with_facts
from tasks.simulate.batch.result_stream import result_parts
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.plan_batch import output_location
from tasks.simulate.replay.replay_run import resimulate
from tasks.storage.base.keys import chunk_key, job_key, result_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, job_id, read
from tasks.storage.jobs.runs import stage_token, worlds_of_job
from tasks.storage.store_url import store_id
from tasks.worlds.job.generation_job import KIND as GENERATION
from tasks.worlds.job.generation_job import MOST_REMADE, world_changes
from tasks.worlds.job.production import Order

_CHUNKS_KEPT = 4
_SAME_BITS = frozenset({"x86_64", "AMD64"})
_SHOWN = 3
# Of a batch that was ended early most episodes may have been left out.
_DRAWS_EACH = 50


def sample_changes(batch: OpenBatch, bundles: Mapping[str, Path], most: int, draw: Random | None = None) -> list[str]:
    """Returns which of some episodes come out otherwise when they are simulated again, one line each.

    None are drawn where a lane's last bits may depend on its place (docs/decisions/0004).

    Args:
        batch: All its chunks are committed.
        bundles: Unpacked folders of its applications, by digest.
        most: How many episodes to draw.
        draw: Draws them; unpredictable, if not given.
    """
    drawn = _drawn(batch, most, draw or SystemRandom())
    runner = ChunkRunner(bundles, batch.plan.engine, batch.plan.recordings.rateHz, lambda _: None)
    again = resimulate(batch, [batch.layout.request(row.index) for row in drawn], runner.run)
    changes = [
        f"{batch.store.url}/{chunk_key(batch.id, batch.layout.chunk_of(row.index))}: {change}"
        for row, computed in zip(drawn, again, strict=True)
        for change in row_changes([row], [computed])
    ]
    more = (
        [f"{len(changes)} of {len(drawn)} episodes came out otherwise when they were simulated again"]
        if changes
        else []
    )
    return [*changes[:_SHOWN], *more]


def _drawn(batch: OpenBatch, most: int, draw: Random) -> list[EpisodeResult]:
    """Returns the rows of episodes that came to an end, without the names of their recordings."""
    rows_of = lru_cache(_CHUNKS_KEPT)(lambda number: _rows(batch, number))
    episodes, found = batch.layout.episodes, dict[int, EpisodeResult]()
    for _ in range(_DRAWS_EACH * most):
        if len(found) >= min(most, episodes):
            break
        index = draw.randrange(episodes)
        row = rows_of(batch.layout.chunk_of(index))[index]
        if row.status != CANCELED and row.device != "gpu" and platform.machine() in _SAME_BITS:
            found[index] = row.model_copy(update={"recording": ""})
    return [found[index] for index in sorted(found)]


def _rows(batch: OpenBatch, number: int) -> dict[int, EpisodeResult]:
    rows = counted_chunk(batch.store, batch.id, number, batch.authenticator)
    if rows is None:
        raise StageFailed("MismatchedEtag", f"{batch.store.url}/{chunk_key(batch.id, number)} is gone")
    return {row.index: row for row in rows}


_RAN_ON = frozenset({"engine", "device"})
_CHARACTERS_SHOWN = 200


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


class PlannedRun(NamedTuple):
    """What the document asks for now: the batch's plan, and where its files go."""

    plan: BatchPlan
    location: OutputLocation


def authenticated_record(record: JobRecord, store: Store, gate: Gate, planned: Callable[[], PlannedRun]) -> JobRecord:
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
    if is_sealed(record, batch.authenticator):
        return with_facts(record, batch.plan, facts_of(record.detail))
    found = count_batch(record, store, gate, planned())
    if found.changes:
        raise StageFailed("MismatchedEtag", "; ".join(found.changes), record.arn)
    return found.record


def count_batch(record: JobRecord, store: Store, gate: Gate, planned: PlannedRun) -> BatchRecount:
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
    folders, sealed = bundles(batch), is_sealed(record, batch.authenticator)
    early = _commit_authentic(
        batch, folders, _gate_that_ended(record, gate, sealed=sealed), planned.location, sealed=sealed
    )
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


def _gate_that_ended(record: JobRecord, gate: Gate, *, sealed: bool) -> Gate | None:
    """Returns the gate if it may have ended the batch early; the owner's record says whether anything did."""
    return gate if stops_early(gate) and (not sealed or "stopped_early" in record.detail) else None


def _commit_authentic(
    batch: OpenBatch, folders: Mapping[str, Path], gate: Gate | None, location: OutputLocation, *, sealed: bool
) -> dict[str, JsonValue]:
    """Lets each chunk be one that is vouched for; returns why the batch ended early, if its gate is sure of it."""
    recordings = RecordedEpisodes(batch, location, folders).write
    runner = ChunkRunner(folders, batch.plan.engine, batch.plan.recordings.rateHz, lambda _: None)
    audited = None if sealed else partial(audit_again, batch, folders)
    early, lanes = SequentialStop(batch, gate, audited), batch.plan.lanes
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
    return repr(value)[:_CHARACTERS_SHOWN]


logger = logging.getLogger(__name__)


def planned_run(work: ParsedRun, section: SimulationBatch) -> PlannedRun:
    """Returns what the document asks for now.

    Raises:
        DocumentError: What it refers to is gone.
    """
    gate = work.spec.gate if stops_early(work.spec.gate) else None
    return PlannedRun(batch_plan(section, work.worlds, work.store, work.find(), gate), output_location(section))


def recount_changes(work: ParsedRun, batch: JobRecord | None) -> list[str]:
    """Returns what is not as it was judged, one line each; nothing if all is, or if the document has no gate.

    Args:
        work: The run, with its gate's answer.
        batch: The record of the batch that was judged.
    """
    spec = work.spec
    if spec.gate is None:
        return []
    if spec.simulationBatch is None or batch is None:
        return ["there is no batch that the gate could have judged"]
    gate = spec.gate
    try:
        planned = planned_run(work, spec.simulationBatch)
        early, changes = at_a_time(
            lambda: _sampled_early(batch.id, planned.plan, work.store),
            lambda: _counted_changes(work, gate, batch.id, planned),
        )
        return changes or (_sampled(batch.id, planned.plan, work.store) if early is None else early)
    except (DocumentError, StageFailed) as exc:
        return [exc.reason if isinstance(exc, StageFailed) else " ".join(str(exc).split())]


def _counted_changes(work: ParsedRun, gate: Gate, batch: str, planned: PlannedRun) -> list[str]:
    """Returns which worlds, rows, tables or verdict are not as they were judged, one line each."""
    digests, imported = planned.plan.world_digests, work.found.imported_digests()
    changes = [
        f"world {world} has the SHA-256 {digests[world]}; its source gives {sha256}"
        for world, sha256 in imported.items()
        if digests.get(world, sha256) != sha256
    ]
    if section := work.spec.worldGeneration:
        made = [world for world in work.worlds if world not in imported]
        changes += section_world_changes(section, made, digests, store=work.store, base=work.base, run=work.run)
    if changes:
        return changes
    found = count_batch(read(work.store, KIND, batch), work.store, gate, planned)
    return found.changes or _verdict_changes(work, gate, found)


def _sampled_early(batch: str, plan: BatchPlan, store: Store) -> list[str] | None:
    """Returns what `_sampled` does, while the batch is counted; None if it cannot be told before that has ended.

    So it is of a batch with a chunk that the count simulates anew, and of one whose fault the count tells better.
    """
    try:
        return _sampled(batch, plan, store)
    except Exception as exc:  # noqa: BLE001 - whatever it is: the count says what is wrong, or it is raised after it
        logger.debug("a sample is simulated after the count: %s", exc)
        return None


def _sampled(batch: str, plan: BatchPlan, store: Store) -> list[str]:
    """Returns which of a few episodes of a batch come out otherwise when they are simulated again, one line each."""
    opened = require_plan(store, batch, plan)
    return sample_changes(opened, bundles(opened), RECOUNT.value())


def section_world_changes(
    section: WorldGeneration,
    worlds: Sequence[str],
    digests: Mapping[str, str],
    *,
    store: Store,
    base: str,
    run: JobRecord,
) -> list[str]:
    """Returns which worlds of a run are not those that its section gives, one line each.

    Args:
        section: The document's section.
        worlds: ``<generation>/<world>`` of each world of the run, in order.
        digests: SHA-256 of each world's document, as they are driven in.
        store: Where the template is.
        base: Folder that the document's relative paths start from.
        run: The run.
    """
    template = find_template(section.template, store, Path(base))
    named, token = arn("world-template", store_id(store), template_digest(template)), stage_token(run, "worlds")
    parts = section_parts(section, worlds_of_job(store, token))
    changes: list[str] = []
    seen = 0
    for part in parts:
        request = generation_request(section, part, template=named, token=token)
        order = Order(
            template=template,
            seed=section.seed,
            generation=job_id(GENERATION, request.clientRequestToken or ""),
            robot_radius_m=section.robotRadius,
        )
        own = [world for world in worlds if len(parts) == 1 or world.startswith(f"{order.generation}/")]
        seen += len(own)
        most = -(-MOST_REMADE // len(parts))
        changes += world_changes(order, request, own, digests, first=part.first, most=most)
    if seen != len(worlds):
        changes.append(f"the run names worlds of generations that it did not ask for: {worlds!r:.200}")
    return changes


def _verdict_changes(work: ParsedRun, gate: Gate, found: BatchRecount) -> list[str]:
    """Returns what the run's record says of the verdict, if it is not what comes of the recounted batch."""
    store, run = work.store, work.run
    answer = read_gate_answer(store, run)
    key = f"{store.url}/{job_key(run.kind, run.id)}"
    if answer is None:
        return [f"{key} says no gate's answer"]
    other = _compared(work, gate)
    if isinstance(other, str):
        return [other]
    rare = (
        search_batch(store.url, found.batch.id, work.spec.search, run.id).found.probability
        if work.spec.search
        else None
    )
    material = replace(gate_material(gate, found.record, store, other), attempts=answer.attempts, rare=rare)
    verdict = judge(gate, material)
    if verdict.verdict != "PASS" or answer.verdict != verdict.verdict:
        return [f"{key} says the verdict {answer.verdict}; computed: {verdict.sentence}"]
    evidence = gather(
        found.batch.id,
        gate,
        verdict,
        tested_facts(found.batch.plan, found.record),
        left_out=material.lacks.left_out,
        baseline=other if isinstance(other, Baseline) else None,
        ships=work.found.ships,
    )
    return _evidence_changes(store, answer, evidence)


def _evidence_changes(store: Store, answer: GateAnswer, computed: Evidence) -> list[str]:
    found = evidence_digest(computed)
    if answer.evidence == found:
        return []
    key = f"{store.url}/{result_key(answer.batch, 'evidence.json')}"
    return [f"{key} has the SHA-256 {answer.evidence}; computed: {found}"]


def _compared(work: ParsedRun, gate: Gate) -> Baseline | NoBaseline | str | None:
    """Returns what the gate compares with; a text if that is not what the document asks for."""
    if gate.noWorseThan is None or work.spec.simulationBatch is None:
        return None
    other = read_baseline(work.store, work.run)
    if other is None:
        return NoBaseline("the run found none")
    meant = compared_digest(gate, work.spec.simulationBatch, work.find())
    if other.digest != meant:
        return f"{work.run.id} says it compared with {other.digest!r:.80}; the document's version is {meant}"
    return other
