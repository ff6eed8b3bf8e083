"""The gate of a run: judges its batch, pins the answer and the baseline in the run's record, lets a bundle be shipped.

A run that is killed and continued finds both there, and so judges the same.

Who runs a document again with other seeds until it passes gets a false PASS more often than its confidence says. So
each run that does not pass leaves a name in the store, in a folder of the document's name, its gate and the bundles
that were tested. One listing counts them; no record is opened. The same episodes judged again are the same attempt.
Whoever may write to the store can remove such names. They decide nothing: they are what the sentence says.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc
from pydantic import JsonValue

from flows.batch.world_identity import world_differences, world_identities
from flows.pipeline.baselines import NoBaseline, find_baseline, read_drives, results_digest, sealed_record
from flows.pipeline.tested_batch import candidates, tested_bundles
from specs.arn import parse_reference
from specs.base import Spec, canonical_document, canonical_json, digest, without_absent
from specs.data.parity_audit import audit_report
from specs.data.run_report import StageReport, Verdict
from specs.errors import ResourceNotFound, StageFailed
from specs.pipeline.gate_section import Gate
from specs.pipeline.search_section import Search
from tasks.deploy.rollout.operator_commands import steer
from tasks.results.gate.evidence import (
    Baseline,
    TestedBatch,
    evidence_digest,
    evidence_faults,
    gather,
    tested_batch,
    write_evidence,
)
from tasks.results.gate.gate_verdict import GateVerdict, columns_needed, count_rows, false_pass_chance, judge
from tasks.results.gate.impossible_rows import IMPOSSIBLE_COLUMNS
from tasks.results.gate.rules.rule import Completeness, GateMaterial
from tasks.results.gate.shipped_builds import Shipment
from tasks.results.gate.version_pairs import PairCounts, count_pairs
from tasks.results.statistics.found_failures import BatchSearch
from tasks.results.statistics.rare_failures import FailureProbability
from tasks.results.statistics.room_coverage import ROOM_COLUMNS, RoomCoverage, table_coverage
from tasks.results.tables.result_files import RESULTS_FILE, stored_rows
from tasks.simulate.batch.batch_record import KIND, plan_of
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import ATTEMPT, attempt_key, attempts_prefix, job_key, key_pattern
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator, owner_authenticator
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read
from tasks.storage.jobs.runs import document_of_run
from tasks.storage.store_url import open_store

_DIGITS = 32
_BILLION = 1_000_000_000
# What decides neither which episodes a batch has nor what comes of them.
_WORK = frozenset({"lanes", "timeout_s", "recordings", "audit", "shuffled", "worlds", "world_digests"})


def attempts_name(run: JobRecord, gate: Gate, batch: JobRecord, compared_with: str) -> str:
    """Returns what the attempts of a run are counted under: its document's name, its gate, and the tested bundles.

    How sure the gate has to be makes no difference: who asks for less after each attempt goes on, and begins nothing.

    Args:
        run: The run.
        gate: What its document asks for.
        batch: The judged batch.
        compared_with: SHA-256 of the bundle that the gate compares with, or empty.
    """
    tested = candidates(plan_of(batch), compared_with)
    asked: dict[str, JsonValue] = {
        "document": document_of_run(run),
        "gate": _without_confidence(canonical_document(gate)),
        "tested": [*sorted(tested)],
    }
    return hashlib.sha256(canonical_json(asked)).hexdigest()[:_DIGITS]


def _without_confidence(asked: JsonValue) -> JsonValue:
    if isinstance(asked, dict):
        return {name: _without_confidence(value) for name, value in asked.items() if name != "confidence"}
    return [_without_confidence(each) for each in asked] if isinstance(asked, list) else asked


def attempts_before(store: Store, attempts: str, episodes: Callable[[], str]) -> tuple[float, ...]:
    """Returns of each other batch that was judged so without a PASS how often it would have passed wrongly by chance.

    Args:
        store: Where attempts are noted.
        attempts: What they are counted under.
        episodes: Gives the name of this batch's episodes; not asked where there is no other attempt.
    """
    form, known = key_pattern(ATTEMPT, attempts=attempts), dict[str, int]()
    for found in map(form.fullmatch, store.keys(attempts_prefix(attempts))):
        if found:
            known[found["episodes"]] = max(known.get(found["episodes"], 0), int(found["error"]))
    known.pop(episodes() if known else "", None)
    return tuple(sorted(error / _BILLION for error in known.values()))


def note_attempt(store: Store, attempts: str, episodes: str, batch: str, error: float) -> None:
    """Notes a batch's episodes, and how often they pass wrongly by chance; doing it again changes nothing."""
    store.put(attempt_key(attempts, episodes, round(error * _BILLION)), canonical_json({"batch": batch}))


def episodes_name(store: Store, plan: BatchPlan, search: Search | None = None) -> str:
    """Returns a name for a batch's episodes: equal worlds, seeds, variables, scenarios and bundles have the same one.

    Worlds that were generated again are the same ones. How the batch was cut into chunks makes no difference.

    Args:
        store: Where the worlds are.
        plan: The batch.
        search: What was searched for besides, if the gate judges that.
    """
    identities = world_identities(store, plan.worlds_used())
    asked = canonical_document(plan.model_copy(update={"templates": ()}))
    known = {name: value for name, value in asked.items() if name not in _WORK}
    templates: list[JsonValue] = [
        {
            "request": digest(template.model_copy(update={"worlds": (), "record": False})),
            "worlds": [*sorted(identities[world] for world in plan.worlds_of(template))],
        }
        for template in plan.templates
    ]
    more: dict[str, JsonValue] = {} if search is None else {"search": canonical_document(search)}
    body = canonical_json({**known, "templates": [*sorted(templates, key=str)], **more})
    return hashlib.sha256(body).hexdigest()[:_DIGITS]


# They tell the tested version from another one in the same batch, and count its episodes.
_EPISODES = ("robot_digest", "status", "success")
_GATE, _BASELINE, _SEAL = "gate", "baseline", "Seal"


class GateAnswer(Spec):
    """What a run's record says of its gate.

    Attributes:
        batch: Id of the batch that was judged.
        evidence_url: Where its evidence is.
        evidence: SHA-256 of it.
        rooms: How much of its worlds the robots were in; None where nothing says that.
        attempts: Of each earlier attempt, on other episodes of the same version and without a PASS, how often it passes
            wrongly by chance.
    """

    batch: str
    verdict: Verdict
    sentence: str
    evidence_url: str
    evidence: str
    rooms: RoomCoverage | None = None
    attempts: tuple[float, ...] = ()


class BatchJudgement(NamedTuple):
    """A gate's verdict, and where its evidence is, with its SHA-256."""

    verdict: GateVerdict
    url: str
    digest: str


def judge_batch(
    store_url: str,
    batch: str,
    gate: Gate,
    *,
    other: Baseline | NoBaseline | None,
    ships: Shipment | None,
    attempts: tuple[float, ...] = (),
    rare: FailureProbability | None = None,
) -> BatchJudgement:
    """Returns the gate's verdict on a batch, whose evidence is written; a step: a plain function of data.

    Args:
        store_url: Where the batch is, and evidence is kept.
        batch: The batch's id.
        gate: What the document asks for.
        other: The version that ``noWorseThan`` compares with, or why there is none; None if nobody asks.
        ships: What the document ships, if it deploys.
        attempts: Of each earlier attempt, how often it passes wrongly by chance.
        rare: How probable a failure is, where the document asks for a search.
    """
    store = open_store(store_url)
    record = read(store, KIND, batch)
    found = replace(gate_material(gate, record, store, other), attempts=attempts, rare=rare)
    verdict = judge(gate, found)
    baseline = other if isinstance(other, Baseline) else None
    tested, left_out = tested_facts(plan_of(record), record), found.lacks.left_out
    evidence = gather(batch, gate, verdict, tested, left_out=left_out, baseline=baseline, ships=ships)
    return BatchJudgement(verdict, write_evidence(store, evidence), evidence_digest(evidence))


def gate_answer(
    gate: Gate,
    batch: JobRecord,
    store: Store,
    run: JobRecord,
    ships: Shipment | None = None,
    *,
    judged: Callable[..., BatchJudgement] = judge_batch,
    searched: BatchSearch | None = None,
) -> GateAnswer:
    """Returns the answer on a batch: the one that the run's record has, or a new one, which it has then.

    A run that was killed after its gate is not judged again: its evidence stands, and is held against what it speaks of
    before anything is shipped. An answer that this owner does not vouch for is only compared with a new one.

    Args:
        gate: What the document asks for.
        batch: An ended batch.
        store: Where both records are.
        run: The run, in whose record the answer is pinned.
        ships: What the document ships, if it deploys.
        judged: Judges, as `judge_batch` does.
        searched: What the document's search found, if it asks for one.

    Raises:
        StageFailed: The results are not what the batch wrote, or the run's record has an answer that does not follow.
    """
    pinned = read_gate_answer(store, run)
    if pinned is not None and _is_authentic(store, run, _GATE):
        return pinned
    # The id is a string of its own: by the record's, Prefect would know the batch's flow run as the task's input, and
    # where one has such an input, the page of a run shows no task runs at all (3.8.8).
    name = parse_reference(batch.arn).path
    other = _baseline(gate, batch, store, run)
    name_of_attempts = attempts_name(run, gate, batch, other.digest if isinstance(other, Baseline) else "")
    beside = searched.search if searched and gate.failureProbability else None
    episodes = cache(lambda: episodes_name(store, plan_of(batch), beside))  # for which each world is read
    # A run that goes on says what it said, whatever was attempted meanwhile.
    attempts = pinned.attempts if pinned else attempts_before(store, name_of_attempts, episodes)
    rare = {"rare": searched.probability} if searched else {}
    verdict, url, sha256 = judged(store.url, name, gate, other=other, ships=ships, attempts=attempts, **rare)
    answer = GateAnswer(
        batch=batch.id,
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        evidence_url=url,
        evidence=sha256,
        rooms=verdict.rooms,
        attempts=attempts,
    )
    if pinned not in (None, answer):
        raise _another_answer(store, run, pinned, answer)
    if answer.verdict != "PASS":
        note_attempt(store, name_of_attempts, episodes(), batch.id, false_pass_chance(gate))
    _pin(store, run, _GATE, answer)
    return answer


def read_gate_answer(store: Store, run: JobRecord) -> GateAnswer | None:
    """Returns what the gate of a run answered, or None as long as it has not."""
    said = read(store, "pipeline-run", run.id).detail.get(_GATE)
    return GateAnswer.model_validate(said) if said is not None else None


def read_baseline(store: Store, run: JobRecord) -> Baseline | None:
    """Returns the version that the gate of a run compares with, once it has found one that its owner vouches for."""
    found = read(store, "pipeline-run", run.id).detail
    vouched = _BASELINE in found and _authenticates(run, _BASELINE, found)
    return Baseline.model_validate(found[_BASELINE]) if vouched else None


def gate_material(
    gate: Gate, batch: JobRecord, store: Store, other: Baseline | NoBaseline | None, *, later: bool = False
) -> GateMaterial:
    """Returns what the gate judges a batch by: of the tested version alone, where another one is in the batch too.

    Args:
        gate: What is asked for.
        batch: An ended batch.
        store: Where it is.
        other: The version to compare with, or why there is none; None if nobody asks.
        later: Whether the gate may be another one than that of the batch's run. What may have ended the batch is the
            run's gate then: an interval that holds at all looks holds for any bar, and no other interval does.
    """
    plan = plan_of(batch)
    both = plan.shuffled == "pairs" and not (isinstance(other, Baseline) and other.batch == batch.id)
    rows = _rows(
        store, batch, list(dict.fromkeys([*columns_needed(gate), *IMPOSSIBLE_COLUMNS, *ROOM_COLUMNS, *_EPISODES]))
    )
    if isinstance(other, Baseline):
        meant = candidates(plan, other.digest)
        rows = rows.filter(pc.field("robot_digest").isin(list(meant)))
    counts = count_rows(rows)
    stop = cast("dict[str, JsonValue]", batch.detail.get("stopped_early", {}))
    ended_by_it = later or without_absent(stop.get("gate")) == canonical_document(gate)
    left_out = cast("int", stop["left_out"]) if stop and ended_by_it else 0
    if plan.shuffled == "pairs" and not both:
        left_out //= 2
    return GateMaterial(
        counts=counts,
        lacks=Completeness(
            canceled=counts.canceled - left_out,
            left_out=left_out,
            looks=tuple(look * (1 + both) for look in Layout(plan).looks()) if later or gate.stopEarly else (),
            paired=plan.shuffled == "pairs" and not both,
        ),
        rows=rows,
        pairs=_pairs(batch, store, other),
        audit=audit_report(batch.detail),
        rooms=table_coverage(rows),
        worlds=world_differences(store, plan_of(batch).worlds_used()),
    )


def tested_facts(plan: BatchPlan, batch: JobRecord) -> TestedBatch:
    """Returns what a batch tested, and with what, for its evidence."""
    return tested_batch(
        robots=[template.robot for template in plan.templates],
        simulations=[template.scenario for template in plan.templates],
        worlds=plan.worlds_used(),
        seeds=plan.seeds_used(),
        variables=plan.variables(),
        metadata=cast("dict[str, str]", batch.detail["metadata"]),
        files=cast("dict[str, str]", batch.detail["sha256s"]),
    )


def _baseline(gate: Gate, batch: JobRecord, store: Store, run: JobRecord) -> Baseline | NoBaseline | None:
    """Returns the version that the gate compares with, the same one whenever the run is continued."""
    if gate.noWorseThan is None:
        return None
    pinned = read_baseline(store, run)
    if pinned is not None:
        return pinned
    found = find_baseline(gate.noWorseThan, batch, store)
    if isinstance(found, Baseline):
        _pin(store, run, _BASELINE, found)
    return found


def _pairs(batch: JobRecord, store: Store, other: Baseline | NoBaseline | None) -> PairCounts | str:
    if other is None:
        return ""
    if isinstance(other, NoBaseline):
        return other.why
    theirs = batch if other.batch == batch.id else sealed_record(store, other.batch)
    if theirs is None or results_digest(theirs) != other.sha256:
        return f"nobody vouches for the results of {other.batch!r:.80}"
    ours = read_drives(store, batch, candidates(plan_of(batch), other.digest))
    return count_pairs(ours, read_drives(store, theirs, [other.digest]))


def _rows(store: Store, batch: JobRecord, columns: list[str]) -> pa.Table:
    digests = cast("dict[str, str]", batch.detail["sha256s"])
    place, written = recorded_location(batch), digests[RESULTS_FILE]
    return stored_rows(store, place, batch.id, RESULTS_FILE, sha256=written, columns=columns)


def _pin(store: Store, run: JobRecord, key: str, value: Spec) -> None:
    now, said = read(store, "pipeline-run", run.id), value.model_dump(mode="json")
    mac = _authenticator(run).mac(key, canonical_json(said))
    advance(store, "pipeline-run", run.id, now.status, detail={key: said, f"{key}{_SEAL}": mac})


def _is_authentic(store: Store, run: JobRecord, key: str) -> bool:
    return _authenticates(run, key, read(store, "pipeline-run", run.id).detail)


def _authenticates(run: JobRecord, key: str, detail: Mapping[str, JsonValue]) -> bool:
    mac, said = detail.get(f"{key}{_SEAL}"), detail.get(key)
    if not isinstance(mac, str) or not isinstance(said, dict):
        return False
    return _authenticator(run).authenticates(mac, key, canonical_json(said))


def _authenticator(run: JobRecord) -> BatchAuthenticator:
    return owner_authenticator(run.id, "")


def _another_answer(store: Store, run: JobRecord, said: GateAnswer | None, computed: GateAnswer) -> StageFailed:
    key = f"{store.url}/{job_key(run.kind, run.id)}"
    said_text = f"{said.verdict} ({said.sentence[:200]!r})" if said else ""
    why = f"{key} says the verdict {said_text}, which this owner has not written; computed: {computed.sentence}"
    return StageFailed("MismatchedEtag", why)


_JOB = "deployment-job"


def shippable(batch: JobRecord, store: Store, run: JobRecord) -> dict[str, str]:
    """Returns the digest of each robot application that a batch tested, by name, but for what it was compared with."""
    other = read_baseline(store, run)
    return tested_bundles(plan_of(batch), other.digest if other else "")


def evidence_changes(
    shipped: str, store: Store, run: JobRecord, *, gated: bool = True, ships: Shipment | None = None
) -> list[str]:
    """Returns what is not as the gate of a run saw it, one line each; nothing if all is, or if there is no gate.

    Args:
        shipped: SHA-256 of the bundle that is to be shipped.
        store: Where everything is.
        run: The pipeline's run, with its gate's answer.
        ships: What is to be shipped, build by build.
        gated: Whether the document has a gate, without whose answer nothing is shipped.
    """
    answer = read_gate_answer(store, run)
    if answer is None:
        missing = f"{store.url}/{job_key(run.kind, run.id)} says no gate's answer, and the document has a gate"
        return [missing] if gated else []
    return evidence_faults(
        store,
        answer.batch,
        answer.evidence,
        shipped,
        lambda batch: recorded_location(read(store, KIND, batch)),
        ships=ships,
    )


def refusal_report(found: list[str], seconds: float) -> StageReport:
    """Returns the report of a deployment that was refused, naming all that has changed."""
    why = "; ".join(found)
    summary = f"nothing was deployed, since the evidence does not hold: {why}"
    facts: dict[str, JsonValue] = {"alarm": f"The deployment was refused: {why}"}
    return StageReport(name="deployment", arn="", status="Refused", summary=summary, seconds=seconds, facts=facts)


def withdraw_deployment(store: Store, token: str) -> None:
    """Cancels the deployment that the run began before it was killed, so that no further robot is asked."""
    try:
        record = read(store, _JOB, job_id(_JOB, token))
    except ResourceNotFound:
        return
    if not is_terminal(record):
        steer(store, record.id, "cancel")
