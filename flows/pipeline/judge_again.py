"""`simyard gate`: judges a batch that has ended by the gate of a document; nothing is simulated, nothing may ship."""

import hashlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

from flows.batch.batch_end import ended_batch
from flows.batch.search_batch import stored_search
from flows.pipeline.baselines import NoBaseline, find_baseline
from flows.pipeline.bundle_checks import planned_names
from flows.pipeline.run_gate import gate_material, tested_facts
from flows.pipeline.tested_batch import require_one_version
from specs.base import Fault, Spec
from specs.data.run_report import Verdict
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.pipeline.document import PipelineSpec, canonical_digest
from specs.pipeline.gate_section import Gate, metric_faults
from tasks.results.gate.evidence import Baseline, LaterEvidence, WrittenEvidence, gather, write_later_evidence
from tasks.results.gate.gate_verdict import GateVerdict, judge
from tasks.results.gate.rules.quantiles import measured_names
from tasks.results.gate.rules.rule import GateMaterial, RuleVerdict
from tasks.results.report.batch_facts import read_judgement
from tasks.results.statistics.batch_summary import EpisodeCounts
from tasks.results.statistics.room_coverage import RoomCoverage, coverage_line, coverage_warnings
from tasks.simulate.batch.batch_record import load_batch, plan_of
from tasks.simulate.batch.provenance import unvouched_notice
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord

_AGAIN = "run its document again to have a batch that can be judged"


class LaterVerdict(Spec):
    """A batch's verdict under a document's gate, made after its run.

    Attributes:
        batch: The batch's ARN.
        document: SHA-256 of the document.
        verdict: The gate's answer.
        sentence: Why, for a person; a line for each of several rules.
        numbers: What the judged episodes came to.
        rules: The answer of each rule.
        rooms: How much of its worlds the robots were in; None where its tables do not say.
        warnings: What keeps the verdict from being about the whole of its worlds.
        run_verdict: What the batch's own run answered; None if it had no gate.
        evidence: Where the evidence is.
        ships: Never: a deployment needs a run of the document.
        notice: What to know of the results before one relies on them; empty if the owner vouches for them.
    """

    batch: str
    document: str
    verdict: Verdict
    sentence: str
    numbers: EpisodeCounts
    rules: tuple[RuleVerdict, ...]
    rooms: RoomCoverage | None
    warnings: tuple[str, ...]
    run_verdict: Verdict | None
    evidence: WrittenEvidence
    ships: bool = False
    notice: str = ""

    def lines(self) -> list[str]:
        """Returns the verdict in lines for a person."""
        rooms = [coverage_line(self.rooms)] if self.rooms else []
        run = [f"its run said {self.run_verdict}"] if self.run_verdict else []
        return [*self.sentence.splitlines(), *rooms, *self.warnings, *run]


def judge_again(store: Store, text: str, spec: PipelineSpec) -> LaterVerdict:
    """Returns the verdict of a document's gate on a batch that has ended; its evidence is written beside the run's.

    Args:
        store: The store of the batch.
        text: ARN or id of a batch, of one of its jobs, or of a run of a document.
        spec: The document. Only its gate is asked; what it would simulate or ship is left alone.

    Raises:
        ResourceNotFound: The store has no such batch, or no such version to compare with.
        DocumentError: There is no gate, the batch has not ended, its tables are not what it wrote, or a rule names what
            nobody measured.
    """
    if spec.gate is None:
        allowed = "a section gate with the rules to judge by, such as `gate: {successRate: {atLeast: 0.9}}`"
        raise DocumentError.of("gate", "missing", allowed)
    gate = spec.gate
    record = ended_batch(store, text)
    _require_files(store, record)
    other = _baseline(gate, record, store)
    require_one_version(plan_of(record), other.digest if isinstance(other, Baseline) else "")
    material = gate_material(gate, record, store, other, later=True)
    _require_names(gate, record, store, material)
    if spec.search and gate.failureProbability and (searched := stored_search(store, record.id, spec.search)):
        material = replace(material, rare=searched.probability)
    verdict, notice = judge(gate, material), _notice(store, record)
    evidence = LaterEvidence(
        document=canonical_digest(spec),
        vouched=not notice,
        judged=gather(
            record.id,
            gate,
            verdict,
            tested_facts(plan_of(record), record),
            left_out=material.lacks.left_out,
            baseline=other if isinstance(other, Baseline) else None,
        ),
    )
    return _answer(store, record, verdict, evidence, notice)


def _answer(
    store: Store, record: JobRecord, verdict: GateVerdict, evidence: LaterEvidence, notice: str
) -> LaterVerdict:
    before = read_judgement(store, record.id)
    return LaterVerdict(
        batch=record.arn,
        document=evidence.document,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        numbers=verdict.counts,
        rules=verdict.rules,
        rooms=verdict.rooms,
        warnings=tuple(coverage_warnings(verdict.rooms)) if verdict.rooms else (),
        run_verdict=before.verdict if before else None,
        evidence=write_later_evidence(store, evidence),
        notice=notice,
    )


def _notice(store: Store, record: JobRecord) -> str:
    if record.status != "Completed":
        return f"{record.id} ended {record.status}, so that nobody vouches for its results"
    return unvouched_notice(load_batch(store, record.id))


def _baseline(gate: Gate, record: JobRecord, store: Store) -> Baseline | NoBaseline | None:
    if gate.noWorseThan is None:
        return None
    try:
        return find_baseline(gate.noWorseThan, record, store)
    except ResourceNotFound as exc:
        faults = [fault.model_copy(update={"path": "gate.noWorseThan.applicationVersion"}) for fault in exc.faults]
        raise ResourceNotFound(faults) from exc


def _require_names(gate: Gate, record: JobRecord, store: Store, material: GateMaterial) -> None:
    """Refuses rules about metrics that no episode has and no scenario of the batch says that it measures.

    Raises:
        DocumentError: With a fault for each such rule.
    """
    seen = measured_names(material.rows) if material.rows is not None else frozenset[str]()
    try:
        declared = planned_names(plan_of(record), store) if gate.quantiles else None
    except ObjectNotFound:  # the bundles may have been cleared away; what was measured is in the tables
        declared = None
    known = seen | (declared or frozenset())
    faults = metric_faults(gate, sorted(known)) if seen or declared is not None else []
    if faults:
        raise DocumentError(faults)


def _require_files(store: Store, record: JobRecord) -> None:
    """Refuses a batch whose files are not those that its record names.

    Raises:
        DocumentError: With a fault for each file.
    """
    faults = list(_file_faults(store, record))
    if faults:
        raise DocumentError(faults, source="simyard")


def _file_faults(store: Store, record: JobRecord) -> Iterator[Fault]:
    place = recorded_location(record)
    bucket = open_bucket(store, place.s3Bucket or "")
    with tempfile.TemporaryDirectory(prefix="simyard-gate-") as folder:
        for name, written in cast("Mapping[str, str]", record.detail["sha256s"]).items():
            key, copy = output_key(place.s3Prefix, f"{record.id}/{name}"), Path(folder) / name
            url = f"{bucket.url}/{key}"
            try:
                bucket.download(key, copy)
            except ObjectNotFound:
                yield Fault(path=url, value="gone", allowed=f"the file that the batch wrote: put it back, or {_AGAIN}")
                continue
            with copy.open("rb") as file:
                found = hashlib.file_digest(file, "sha256").hexdigest()
            if found != written:
                allowed = f"the file that the batch wrote, {written}: put it back, or {_AGAIN}"
                yield Fault(path=url, value=f"SHA-256 {found}", allowed=allowed)
