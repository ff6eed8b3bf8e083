"""Counts again, right before something is shipped, all that its gate has judged by: worlds, plan, rows, verdict."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from flows.batch.replay_episode import bundles
from flows.document.references import Numbers, numbered_finder
from flows.document.tested_batch import batch_plan, compared_digest
from flows.gate.baselines import NoBaseline
from flows.gate.judge import GateAnswer, gate_material, read_baseline, read_gate_answer, tested_facts
from flows.recount.batch_recount import BatchRecount, Planned, count_batch
from flows.recount.sample import sample_changes
from specs.arn import arn
from specs.errors import DocumentError, ObjectNotFound, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate, stops_early
from specs.pipeline.section_requests import generation_request, section_parts
from specs.pipeline.simulation_section import SimulationBatch
from specs.pipeline.world_sections import WorldGeneration
from specs.settings import recount_episodes
from specs.template.body import template_digest
from tasks.documents.template_source import find_template
from tasks.progress.at_a_time import at_a_time
from tasks.results.gate.evidence import Baseline, Evidence, evidence_digest, gather, read_evidence
from tasks.results.gate.gate import judge
from tasks.results.gate.shipped_builds import Shipment
from tasks.simulate.batch.job import KIND, require_plan
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.resolve import output_location
from tasks.storage.base.keys import job_key, result_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, job_id, read
from tasks.storage.jobs.runs import stage_token
from tasks.storage.store_url import store_id
from tasks.worlds.job.job import KIND as GENERATION
from tasks.worlds.job.production import Order
from tasks.worlds.job.world_recount import MOST_REMADE, world_changes

# What an older version says otherwise of the same episodes.
_WORDED = ("version", "sentence", "rules", "tries")

logger = logging.getLogger(__name__)


class Asked(NamedTuple):
    """What a run was asked for, as this process knows it.

    Attributes:
        spec: The document.
        base: Folder that the document's relative paths start from.
        versions: Numbers of the applications that the document brings, by ``<kind>/<name>``.
        worlds: ``<generation>/<world>`` of each world of the run.
        ships: What is shipped, as it was settled before anything ran; None for what the store has now.
    """

    spec: PipelineSpec
    base: str
    versions: Numbers
    worlds: list[str]
    ships: Shipment | None = None


def asked_plan(asked: Asked, section: SimulationBatch, store: Store) -> Planned:
    """Returns what the document asks for now.

    Raises:
        DocumentError: What it refers to is gone.
    """
    gate = asked.spec.gate if stops_early(asked.spec.gate) else None
    plan = batch_plan(section, asked.worlds, store, numbered_finder(store, asked.versions), gate)
    return Planned(plan, output_location(section))


def recount_changes(asked: Asked, batch: JobRecord | None, store: Store, run: JobRecord) -> list[str]:
    """Returns what is not as it was judged, one line each; nothing if all is, or if the document has no gate.

    Args:
        asked: What the run was asked for.
        batch: The record of the batch that was judged.
        store: Where everything is.
        run: The run, with its gate's answer.
    """
    spec = asked.spec
    if spec.gate is None:
        return []
    if spec.simulationBatch is None or batch is None:
        return ["there is no batch that the gate could have judged"]
    try:
        planned = asked_plan(asked, spec.simulationBatch, store)
        early, changes = at_a_time(
            lambda: _sampled_early(batch.id, planned.plan, store),
            lambda: _counted_changes(asked, batch.id, planned, store=store, run=run),
        )
        return changes or (_sampled(batch.id, planned.plan, store) if early is None else early)
    except (DocumentError, StageFailed) as exc:
        return [exc.reason if isinstance(exc, StageFailed) else " ".join(str(exc).split())]


def _counted_changes(asked: Asked, batch: str, planned: Planned, *, store: Store, run: JobRecord) -> list[str]:
    """Returns which worlds, rows, tables or verdict are not as they were judged, one line each.

    Args:
        asked: What the run was asked for, a gate among it.
        batch: The batch's id.
        planned: What the document asks for now.
        store: Where everything is.
        run: The run, with its gate's answer.
    """
    gate = asked.spec.gate
    assert gate is not None  # noqa: S101 - asked before
    changes = _world_changes(asked, planned.plan, store, run)
    if changes:
        return changes
    found = count_batch(read(store, KIND, batch), store, gate, planned)
    return found.changes or _verdict_changes(asked, gate, found, store, run)


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
    return sample_changes(opened, bundles(opened), recount_episodes())


def _world_changes(asked: Asked, plan: BatchPlan, store: Store, run: JobRecord) -> list[str]:
    section = asked.spec.worldGeneration
    if section is None:
        return []
    return section_world_changes(section, asked.worlds, plan.world_digests, store=store, base=asked.base, run=run)


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
    named, parts = arn("world-template", store_id(store), template_digest(template)), section_parts(section)
    changes: list[str] = []
    seen = 0
    for part in parts:
        request = generation_request(section, part, template=named, token=stage_token(run, "worlds"))
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


def _verdict_changes(asked: Asked, gate: Gate, found: BatchRecount, store: Store, run: JobRecord) -> list[str]:
    """Returns what the run's record says of the verdict, if it is not what comes of the recounted batch."""
    answer = read_gate_answer(store, run)
    key = f"{store.url}/{job_key(run.kind, run.id)}"
    if answer is None:
        return [f"{key} says no gate's answer"]
    other = _baseline(asked, gate, store, run)
    if isinstance(other, str):
        return [other]
    material = replace(gate_material(gate, found.record, store, other), tries=answer.tries)
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
        ships=asked.ships,
    )
    return _evidence_changes(store, answer, evidence)


def _evidence_changes(store: Store, answer: GateAnswer, computed: Evidence) -> list[str]:
    found = evidence_digest(computed)
    if answer.evidence == found:
        return []
    key = f"{store.url}/{result_key(answer.batch, 'evidence.json')}"
    if _is_older_form(store, answer, computed):
        return []
    return [f"{key} has the SHA-256 {answer.evidence}; computed: {found}"]


def _is_older_form(store: Store, answer: GateAnswer, computed: Evidence) -> bool:
    """Returns whether an older version wrote the evidence, in other words and with fewer numbers, of the same facts."""
    try:
        pinned = read_evidence(store, answer.batch)
    except (ObjectNotFound, ValidationError):
        return False
    said, now = (each.model_dump(mode="json", exclude=set(_WORDED)) for each in (pinned, computed))
    return pinned.version != computed.version and said == now


def _baseline(asked: Asked, gate: Gate, store: Store, run: JobRecord) -> Baseline | NoBaseline | str | None:
    """Returns what the gate compares with; a text if that is not what the document asks for."""
    if gate.noWorseThan is None or asked.spec.simulationBatch is None:
        return None
    other = read_baseline(store, run)
    if other is None:
        return NoBaseline("the run found none")
    meant = compared_digest(gate, asked.spec.simulationBatch, numbered_finder(store, asked.versions))
    if other.digest != meant:
        return f"{run.id} says it compared with {other.digest!r:.80}; the document's version is {meant}"
    return other
