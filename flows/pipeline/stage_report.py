"""What a stage's job left: one line for a person with links to its files, and what was made of what.

The report is made from the job's record. The lineage: worlds -> zip; worlds and applications -> tables -> evidence ->
roll-out. A job that made nothing leaves nothing.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import reduce
from typing import NamedTuple, cast, get_args

from pydantic import JsonValue

from flows.pipeline.run_gate import GateAnswer, read_gate_answer
from flows.pipeline.world_imports import ImportedWorld, imported_summary, unresolved_lines
from specs.arn import RUN_KIND, resource_name
from specs.data.run_report import Artefact, PipelineReport, StageName, StageReport, Verdict
from specs.data.world import Certificate
from specs.errors import DocumentError, ObjectCorrupt, ResourceNotFound, StageFailed
from specs.job_kinds import JobKind
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.deploy.rollout.observation import count_in_sync, recorded_progress, rollout_standing
from tasks.deploy.rollout.rollout_plan import RolloutPlan
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM, is_unsigned
from tasks.results.statistics.found_failures import BatchSearch
from tasks.results.statistics.intervals import in_worlds
from tasks.results.statistics.room_coverage import RoomCoverage, coverage_line, coverage_warnings
from tasks.results.tables.result_files import ROOMS, WORLDS
from tasks.simulate.batch.batch_record import plan_of
from tasks.storage.base.keys import bundle_key, contact_sheet_key, job_key, worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.jobs.runs import run_of
from tasks.storage.worlds import read_world, reference_key

_SAMPLES_SHOWN = 2
_ALARMING = frozenset({"SUSPECT", "NOT RUN"})
_SAMPLE_CHARACTERS = 300
JOBS = "jobs"
"""Where the generation jobs of a run are named together, if they are several."""
_WORLDS_READ = 64  # of a job of thousands, reading all would take longer than the line is worth


def recorded_report(run: JobRecord) -> PipelineReport:
    """Returns the report of a run that another process ended.

    Raises:
        DocumentError: It ended without one, because the document was refused.
        StageFailed: It ended without one, because a stage failed.
    """
    report = run.detail.get("report")
    if report is None and run.detail.get("refused"):
        raise DocumentError.of("run", run.id, run.failure_reason)
    if report is None:
        raise StageFailed(run.failure_code, run.failure_reason)
    return PipelineReport.model_validate(report)


def import_report(imported: Mapping[str, Sequence[ImportedWorld]], store: Store, seconds: float) -> StageReport:
    """Returns what became of the worlds that a document imports, with an alarm for what is not there.

    Args:
        imported: By the name of their entry, of which there is at least one; variants of one together.
        store: Where they are.
        seconds: How long it took to draw them.
    """
    artefacts: list[Artefact] = []
    for name, worlds in imported.items():
        first = worlds[0]
        key = reference_key(first.reference) if len(worlds) == 1 else f"worlds/{first.world.generation}"
        artefacts.append(Artefact(label=f"world{'s' * (len(worlds) > 1)} {name}", url=f"{store.url}/{key}"))
        picture = contact_sheet_key(first.world.generation)
        artefacts.append(Artefact(label=f"picture of {name}", url=f"{store.url}/{picture}"))
    stage = StageReport(
        name="worlds",
        arn="",
        status="Completed",
        summary="; ".join(imported_summary(name, [each.world for each in found]) for name, found in imported.items()),
        seconds=seconds,
        artefacts=tuple(artefacts),
    )
    # Variants lack what the building lacks that they are made of.
    return reduce(with_alarm, [line for found in imported.values() for line in unresolved_lines(found[0].world)], stage)


def generation_report(record: JobRecord, store: Store, seconds: float) -> StageReport:
    """Returns what a generation job made."""
    jobs = texts(record.detail, JOBS) or [record.id]
    artefacts = [Artefact(label="worlds", url=f"{store.url}/worlds/{job}") for job in jobs]
    sheets = [contact_sheet_key(job) for job in jobs]
    artefacts += [Artefact(label="contact sheet", url=f"{store.url}/{key}") for key in sheets if store.exists(key)]
    stage = _stage("worldGeneration", record, _generation_summary(record), seconds, tuple(artefacts))
    certificates: list[Certificate] = []
    for reference in texts(record.detail, "worlds")[:_WORLDS_READ]:
        with suppress(ResourceNotFound):  # worlds that are gone say nothing
            certificates.append(read_world(store, reference, record.id).certificate)
    unmet = [wish for certificate in certificates for wish in certificate.unmet]
    said = [stage.summary, *_doors_sentence(certificates), *([_unmet_sentence(record, unmet)] if unmet else [])]
    facts: dict[str, JsonValue] = {"unmet_wishes": len(unmet)} if unmet else {}
    return stage.model_copy(update={"summary": "; ".join(said), "facts": facts})


def _doors_sentence(certificates: Sequence[Certificate]) -> Iterator[str]:
    """Yields where doors stand too far shut for the radius that open ones let in; no wish: the template sets them."""
    narrow = [each for each in certificates if each.doors_as_set_robot_radius_m < each.guaranteed_robot_radius_m]
    if narrow:
        radius_m = max(each.guaranteed_robot_radius_m for each in narrow)
        least_m = min(each.doors_as_set_robot_radius_m for each in narrow)
        fits = f"one of {least_m:.2f} m does" if least_m else "some doors are shut"
        yield (
            f"with doors as set, a robot of {radius_m:.2f} m radius may not get into every room of "
            f"{_number(len(narrow), 'world')}: {fits}"
        )


def _unmet_sentence(record: JobRecord, unmet: Sequence[str]) -> str:
    worlds = len(texts(record.detail, "worlds"))
    of_first = f" of the first {_WORLDS_READ} worlds" if worlds > _WORLDS_READ else ""
    often = Counter(unmet).most_common(_SAMPLES_SHOWN)
    named = "; ".join(f"{wish}" + (f" ({count} worlds)" if count > 1 else "") for wish, count in often)
    more = "; ..." if len(set(unmet)) > len(often) else ""
    return f"{_number(len(unmet), 'wish', 'wishes')}{of_first} not fulfilled: {named}{more}"


def export_report(record: JobRecord, seconds: float) -> StageReport:
    """Returns what an export job wrote."""
    plans = texts(record.detail, "svg")
    artefacts = [Artefact(label="worlds, zipped", url=str(record.detail["zip"]))]
    artefacts += [Artefact(label="floor plan", url=url) for url in plans[:1]]
    return _stage("worldExport", record, _export_summary(record), seconds, tuple(artefacts))


def batch_report(record: JobRecord, seconds: float) -> StageReport:
    """Returns what a batch came to.

    Raises:
        ObjectCorrupt: Its record does not say that: somebody else has written to it.
    """
    try:
        return _batch_report(record, seconds)
    except (LookupError, TypeError, ValueError) as exc:
        lacks = f"{type(exc).__name__}: {exc}".splitlines()[0]
        raise ObjectCorrupt(f"the record of {record.arn} was not written by this version of Simyard: {lacks}") from exc


def _batch_report(record: JobRecord, seconds: float) -> StageReport:
    detail, asked = record.detail, record.detail["episodes"]
    if "stopped_early" in detail:
        asked = cast("dict[str, JsonValue]", detail["stopped_early"])["episodes"]
    # Records of older versions do not say in how many worlds.
    where = f" {in_worlds(cast('int', detail[WORLDS]))}" if WORLDS in detail else ""
    summary = f"{detail['passed']} of {asked} episodes passed{where}, {detail['simulated_s']:.0f} simulated seconds"
    summary += _why_not(cast("list[dict[str, JsonValue]]", detail.get("why_not", [])))
    if "stopped_early" in detail:
        summary += f"; {cast('dict[str, JsonValue]', detail['stopped_early'])['sentence']}"
    artefacts = tuple(
        Artefact(label=label, url=str(detail[f"{label}_url"]))
        for label in ("report", "results", "failures", "recordings", "bags", "audit")
        if f"{label}_url" in detail
    )
    stage = _stage("simulationBatch", record, summary, seconds, artefacts)
    if "audit" in detail:
        stage = _with_audit(stage, cast("dict[str, JsonValue]", detail["audit"]))
    if ROOMS in detail:
        found = RoomCoverage.model_validate(detail[ROOMS])
        stage = _with_rooms(stage.model_copy(update={"summary": f"{stage.summary}; {coverage_line(found)}"}), found)
    return with_alarm(stage, f"There is no report: {detail['report_failed']}") if "report_failed" in detail else stage


def require_an_end(record: JobRecord) -> None:
    """Refuses a batch none of whose episodes came to its end; for a run that has no gate to judge it.

    Raises:
        StageFailed: Each job of the batch failed; with the most frequent code, and what the first one says.
    """
    detail = record.detail
    reasons = cast("list[dict[str, JsonValue]]", detail.get("why_not", []))
    failed = [each for each in reasons if each["reason"] in get_args(SimulationJobErrorCode)]
    if failed and sum(cast("int", each["episodes"]) for each in failed) == detail["episodes"]:
        most = max(failed, key=lambda each: cast("int", each["episodes"]))
        why = f"all {detail['episodes']} episodes failed, and none came to its end{_why_not(reasons)}"
        raise StageFailed(str(most["reason"]), f"{why}; simyard report shows them", record.arn)


def gate_report(
    verdict: Verdict, sentence: str, evidence_url: str, seconds: float, rooms: RoomCoverage | None = None
) -> StageReport:
    """Returns what the gate answered; the verdict is the status, so the summary leaves it out.

    Args:
        verdict: The gate's.
        sentence: Why, beginning with the verdict.
        evidence_url: Where the evidence is.
        seconds: How long judging took.
        rooms: How much of its worlds the robots were in; None where nothing says that.
    """
    evidence = Artefact(label="evidence", url=evidence_url)
    said = sentence.removeprefix(f"{verdict}: ")
    stage = StageReport(name="gate", arn="", status=verdict, summary=said, seconds=seconds, artefacts=(evidence,))
    return _with_rooms(stage, rooms)


def search_report(found: BatchSearch, url: str, seconds: float) -> StageReport:
    """Returns what a search over the batch found.

    Args:
        found: The probability and the failures.
        url: Where both are.
        seconds: How long it took now.
    """
    said = f"{found.probability.sentence}; {found.findings}; {found.causes.sentence}"
    artefacts = (Artefact(label="search", url=url),)
    return StageReport(
        name="search",
        arn="",
        status="Completed",
        summary=said,
        seconds=seconds,
        artefacts=artefacts,
        facts={**found.facts()},
    )


def deployment_report(record: JobRecord, seconds: float) -> StageReport:
    """Returns how a roll-out went."""
    seen = recorded_progress(record)
    summary, in_sync = "; ".join(filter(None, rollout_standing(record, seen))), count_in_sync(seen)
    facts: dict[str, JsonValue] = {"behind": len(seen) - in_sync} if in_sync < len(seen) else {}
    stage = _stage("deployment", record, summary, seconds, ()).model_copy(update={"facts": facts})
    if not is_unsigned(record):
        return stage
    return stage.model_copy(update={"summary": f"{summary}; UNSIGNED", "facts": {**facts, "alarm": UNSIGNED_ALARM}})


def job_summary(record: JobRecord) -> str:
    """Returns how a stage's job ended, in one line: what its report says first.

    Args:
        record: The job that a flow of one stage returned.
    """
    if record.kind == "world-generation-job":
        return _generation_summary(record)
    if record.kind == "world-export-job":
        return _export_summary(record)
    report = deployment_report if record.kind == "deployment-job" else batch_report
    return report(record, 0.0).summary


def _generation_summary(record: JobRecord) -> str:
    worlds = texts(record.detail, "worlds")
    failed = sum(cast("int", failure["count"]) for failure in _mappings(record.detail, "failures").values())
    return f"{_number(len(worlds), 'world')}" + (f", {failed} failed" if failed else "")


def _export_summary(record: JobRecord) -> str:
    plans = texts(record.detail, "svg")
    return "1 zip" + (f", {_number(len(plans), 'floor plan')}" if plans else "")


def with_alarm(stage: StageReport, alarm: str) -> StageReport:
    """Returns a stage's report with one more alarm, a line each; an alarm that it has is not repeated."""
    before = str(stage.facts.get("alarm", "")).splitlines()
    return stage.model_copy(update={"facts": {**stage.facts, "alarm": "\n".join(dict.fromkeys([*before, alarm]))}})


def run_with_alarm(report: PipelineReport, alarm: str) -> PipelineReport:
    """Returns a run's report with one more alarm, unless one of its stages has it already."""
    if any(alarm in str(stage.facts.get("alarm", "")) for stage in report.stages):
        return report
    return report.model_copy(update={"stages": (*report.stages[:-1], with_alarm(report.stages[-1], alarm))})


def _why_not(reasons: Sequence[Mapping[str, JsonValue]]) -> str:
    """Returns every reason with its episodes, and what the first episode of the most frequent ones says."""
    text = ""
    for place, entry in enumerate(reasons):
        sample = str(entry["sample"])[:_SAMPLE_CHARACTERS] if place < _SAMPLES_SHOWN else ""
        text += f"; {entry['episodes']} x {entry['reason']}" + (f": {sample}" if sample else "")
    return text


def texts(detail: Mapping[str, JsonValue], key: str) -> list[str]:
    """Returns a record's list of texts."""
    return [str(item) for item in cast("list[JsonValue]", detail.get(key, []))]


def _number(number: int, thing: str, things: str = "") -> str:
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"


def _mappings(detail: Mapping[str, JsonValue], key: str) -> Mapping[str, Mapping[str, JsonValue]]:
    return cast("Mapping[str, Mapping[str, JsonValue]]", detail.get(key, {}))


def _with_audit(stage: StageReport, audit: dict[str, JsonValue]) -> StageReport:
    """Returns a batch's report with its audit, and with an alarm unless the audit is sound or says less by design."""
    verdict, sentence = str(audit["verdict"]), str(audit["sentence"]).removeprefix("not run: ")
    facts: dict[str, JsonValue] = {"audit": audit}
    if verdict in _ALARMING:
        facts["alarm"] = f"The parity audit is {verdict}: {sentence}"
    return stage.model_copy(update={"summary": f"{stage.summary}; audit {verdict}: {sentence}", "facts": facts})


def _with_rooms(stage: StageReport, found: RoomCoverage | None) -> StageReport:
    """Returns a stage's report with the rooms that robots were in, and an alarm where they were kept out of some."""
    if found is None:
        return stage
    stage = stage.model_copy(update={"facts": {**stage.facts, ROOMS: found.model_dump(mode="json")}})
    for warning in coverage_warnings(found):
        stage = with_alarm(stage, warning)
    return stage


def _stage(
    name: StageName, record: JobRecord, summary: str, seconds: float, artefacts: tuple[Artefact, ...]
) -> StageReport:
    return StageReport(
        name=name, arn=record.arn, status=record.status, summary=summary, seconds=seconds, artefacts=artefacts
    )


_MADE = frozenset({"Completed", "PartialFailed", "Succeeded"})


class Asset(NamedTuple):
    """Something in the store.

    Attributes:
        url: Where it is.
        name: What a person calls it.
    """

    url: str
    name: str


class MadeAsset(NamedTuple):
    """Something that a job, or a gate, has made.

    Attributes:
        asset: What.
        sources: What it was made of.
        facts: Counts, digests and verdicts, for a person.
    """

    asset: Asset
    sources: tuple[Asset, ...]
    facts: dict[str, JsonValue]


def made_by(store: Store, job: JobRecord, token: str = "") -> MadeAsset | None:
    """Returns what an ended job has made; None if that is nothing.

    Args:
        store: Where it is.
        job: Of a stage.
        token: The pipeline's for the stage; empty for a stage that runs alone.
    """
    if job.status not in _MADE:
        return None
    return _MAKERS[job.kind](store, job, token)


def evidence_of(store: Store, answer: GateAnswer) -> MadeAsset:
    """Returns the evidence that a gate has written.

    Args:
        store: Where it is.
        answer: The gate's.
    """
    batch = read(store, "simulation-job-batch", answer.batch)
    facts: dict[str, JsonValue] = {
        "verdict": answer.verdict,
        "sentence": answer.sentence,
        "sha256": answer.evidence,
        "batch": batch.arn,
    }
    return MadeAsset(_evidence(answer), (_tables(batch),), facts)


def _worlds_made(store: Store, job: JobRecord, _token: str) -> MadeAsset | None:
    worlds = cast("list[str]", job.detail["worlds"])
    if not worlds:
        return None
    failures = cast("Mapping[str, Mapping[str, int]]", job.detail["failures"])
    facts: dict[str, JsonValue] = {
        "worlds": len(worlds),
        "failed": sum(each["count"] for each in failures.values()),
        "template": job.detail["template_digest"],
        "seed": job.detail["seed"],
        "job": job.arn,
    }
    return MadeAsset(_generation(store, job.id), (), facts)


def _zip_made(store: Store, job: JobRecord, _token: str) -> MadeAsset:
    worlds = [resource_name(each) for each in cast("list[str]", job.request["worlds"])]
    facts: dict[str, JsonValue] = {
        "worlds": len(worlds),
        "formats": job.request["formats"],
        "sha256": job.detail.get("sha256", ""),
        "job": job.arn,
    }
    return MadeAsset(Asset(str(job.detail["zip"]), f"worlds of {job.id}"), _generations(store, worlds), facts)


def _tables_made(store: Store, job: JobRecord, _token: str) -> MadeAsset:
    plan = plan_of(job)
    launches = [launch for template in plan.templates for launch in (template.robot, template.scenario)]
    bundles = [_bundle(store, each.digest, f"{each.name} {each.version}") for each in launches]
    audit = cast("Mapping[str, JsonValue]", job.detail.get("audit") or {})
    facts: dict[str, JsonValue] = {
        "episodes": job.detail["episodes"],
        "passed": job.detail["passed"],
        "sha256s": job.detail["sha256s"],
        **({"audit": audit["verdict"]} if audit else {}),
        "job": job.arn,
    }
    sources = (*_generations(store, plan.worlds_used()), *dict.fromkeys(bundles))
    return MadeAsset(_tables(job), sources, facts)


def _rollout_made(store: Store, job: JobRecord, token: str) -> MadeAsset:
    plan, robots = RolloutPlan.model_validate(job.detail["plan"]), recorded_progress(job)
    version = f"{plan.application} {plan.version}"
    answer = _answer(store, token)
    bundles = [_bundle(store, digest, version) for digest in dict.fromkeys(plan.builds.values()) or (plan.digest,)]
    facts: dict[str, JsonValue] = {
        "fleet": plan.fleet,
        "application": version,
        "sha256": plan.digest,
        "robots": len(robots),
        "inSync": [each.status for each in robots.values()].count("InSync"),
        "job": job.arn,
    }
    where = Asset(f"{store.url}/{job_key(job.kind, job.id)}", f"{version} on {plan.fleet}")
    return MadeAsset(where, (*bundles, *([_evidence(answer)] if answer else [])), facts)


_MAKERS: Mapping[JobKind, Callable[[Store, JobRecord, str], MadeAsset | None]] = {
    "world-generation-job": _worlds_made,
    "world-export-job": _zip_made,
    "simulation-job-batch": _tables_made,
    "deployment-job": _rollout_made,
}


def _answer(store: Store, token: str) -> GateAnswer | None:
    run = run_of(token)
    return read_gate_answer(store, read(store, RUN_KIND, run)) if run else None


def _evidence(answer: GateAnswer) -> Asset:
    return Asset(answer.evidence_url, f"evidence of {answer.batch}")


def _tables(batch: JobRecord) -> Asset:
    return Asset(str(batch.detail["results_url"]), f"results of {batch.id}")


def _bundle(store: Store, digest: str, name: str) -> Asset:
    return Asset(f"{store.url}/{bundle_key(digest)}", name)


def _generation(store: Store, generation: str) -> Asset:
    return Asset(f"{store.url}/{worlds_prefix(generation)}", f"worlds of {generation}")


def _generations(store: Store, worlds: Iterable[str]) -> tuple[Asset, ...]:
    return tuple(_generation(store, each) for each in dict.fromkeys(world.partition("/")[0] for world in worlds))


def joined(jobs: Sequence[JobRecord]) -> JobRecord:
    """Returns the first of a section's generation jobs, with the worlds and the failures of all of them.

    The store keeps each job as it is; what they are together is nowhere but in the run.

    Args:
        jobs: Ended ones, in order, at least one.
    """
    first, *more = jobs
    if not more:
        return first
    failures: dict[str, JsonValue] = {}
    for job in jobs:
        for code, each in cast("Mapping[str, Mapping[str, JsonValue]]", job.detail["failures"]).items():
            known = cast("Mapping[str, JsonValue]", failures.get(code, {"count": 0, **each} | {"count": 0}))
            failures[code] = {**known, "count": cast("int", known["count"]) + cast("int", each["count"])}
    worlds: list[JsonValue] = [world for job in jobs for world in cast("list[JsonValue]", job.detail["worlds"])]
    detail = {**first.detail, "worlds": worlds, "failures": failures, JOBS: [job.id for job in jobs]}
    return first.model_copy(update={"detail": detail, "status": "PartialFailed" if failures else first.status})
