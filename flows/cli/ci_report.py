"""The whole report of a run, however it ended, as its records say; and what a person may do next if it did not pass."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import cast, get_args

from pydantic import JsonValue, ValidationError

from flows.cli.run_command import AskedRun
from flows.pipeline.baselines import find_baseline
from flows.pipeline.judge_again import LaterVerdict
from flows.pipeline.stage_report import batch_report, deployment_report, export_report, generation_report, joined
from specs.arn import arn, resource_kind, resource_name, store_id_of
from specs.data.run_report import Artefact, PipelineReport, StageName, StageReport, Verdict
from specs.errors import DocumentError, ObjectNotFound, PipelineNotPassed, ResourceNotFound, SimyardError, StageFailed
from specs.job_kinds import JOB_KINDS, JobKind
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from tasks.deploy.fleet.fleet_registry import fleet_name
from tasks.results.ci.full_report import Answer, CountedBatch, FullReport, GateReport, RunFailure
from tasks.results.ci.seed_groups import FAILURE_COLUMNS, RESULT_COLUMNS, GroupRules, count_groups
from tasks.results.gate.evidence import Baseline, Evidence, read_evidence
from tasks.results.statistics.power import share_needs
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE, stored_rows
from tasks.simulate.batch.batch_record import KIND, plan_of
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import jobs_of, run_of
from tasks.storage.store_url import open_existing_store, store_id

_GOOD = frozenset({"Completed", "Succeeded", "PartialFailed"})
_CONFIDENCE = 0.95
_ANSWERS: Mapping[Verdict, Answer] = {"PASS": "PASSED", "FAIL": "NOT PASSED", "INCONCLUSIVE": "INCONCLUSIVE"}


def report_of_run(asked: AskedRun, report: PipelineReport, exit_code: int) -> FullReport:
    """Returns the whole report of a run that came to its end, passed or not.

    Args:
        asked: The run.
        report: What each stage did.
        exit_code: What the command ends with.
    """
    answer: Answer = "PASSED" if report.passed else "INCONCLUSIVE" if report.undecided else "NOT PASSED"
    found = FullReport(
        answer=answer,
        exit_code=exit_code,
        document=report.name,
        store=asked.store_url,
        run=report.run,
        verdict=report.verdict,
        shipped=report.shipped,
        stages=report.stages,
    )
    return _with_batch(asked, found)


def report_of_failure(asked: AskedRun, failure: Exception, exit_code: int) -> FullReport:
    """Returns the whole report of a run that has no end of its own: a stage failed, or the document was refused.

    Args:
        asked: The run.
        failure: Why.
        exit_code: What the command ends with.
    """
    if isinstance(failure, PipelineNotPassed):
        return report_of_run(asked, failure.report, exit_code)
    refused = isinstance(failure, DocumentError)
    found = FullReport(
        answer="REFUSED" if refused else "FAILED",
        exit_code=exit_code,
        document=asked.document,
        store=asked.store_url,
        failure=_failure(failure),
    )
    if not isinstance(failure, StageFailed) or not failure.arn:
        return found
    return _tried(found, lambda: _with_stages(asked, found, failure.arn))


def report_of_judgement(store: Store, spec: PipelineSpec, found: LaterVerdict, exit_code: int) -> FullReport:
    """Returns the whole report of a batch that was judged again, as `simyard gate` does: without a run.

    Args:
        store: Where it is.
        spec: The document that judged.
        found: What it answered.
        exit_code: What the command ends with.
    """
    evidence = (Artefact(label="evidence", url=found.evidence.url),)
    alarms = [*found.warnings, *filter(None, [found.notice])]
    facts: dict[str, JsonValue] = {"alarm": "\n".join(alarms)} if alarms else {}
    said = found.sentence.removeprefix(f"{found.verdict}: ")
    stage = StageReport(
        name="gate", arn="", status=found.verdict, summary=said, seconds=0.0, artefacts=evidence, facts=facts
    )
    report = FullReport(
        answer=_ANSWERS[found.verdict],
        exit_code=exit_code,
        document=spec.name,
        store=store.url,
        verdict=found.verdict,
        stages=(stage,),
        gate=GateReport(verdict=found.verdict, sentence=found.sentence, rules=found.rules),
    )
    return _tried(report, lambda: report.model_copy(update={"batch": _judged_counts(store, spec.gate, found)}))


def _judged_counts(store: Store, gate: Gate | None, found: LaterVerdict) -> CountedBatch:
    record = read(store, KIND, resource_name(found.batch))
    other = find_baseline(gate.noWorseThan, record, store) if gate and gate.noWorseThan else None
    return batch_counts(store, record, gate, found.verdict, other if isinstance(other, Baseline) else None)


def batch_counts(
    store: Store, record: JobRecord, gate: Gate | None, verdict: Verdict | None, baseline: Baseline | None
) -> CountedBatch:
    """Returns a batch that has its tables in groups of episodes.

    Args:
        store: Where it is.
        record: Its record.
        gate: What judged it; None if nothing did.
        verdict: What that answered; None likewise.
        baseline: The version that the gate compared with; None if it compared with none.

    Raises:
        ResourceNotFound: Its tables are gone.
        StageFailed: They are not what it wrote.
    """
    place, digests = recorded_location(record), record.detail["sha256s"]
    written = digests if isinstance(digests, dict) else {}
    results, failures = (
        stored_rows(store, place, record.id, name, sha256=str(written.get(name, "")), columns=columns)
        for name, columns in ((RESULTS_FILE, RESULT_COLUMNS), (FAILURES_FILE, FAILURE_COLUMNS))
    )
    rate = gate.successRate if gate else None
    rules = GroupRules(
        verdict=verdict,
        bar=rate.atLeast if rate else None,
        confidence=rate.confidence if rate else _CONFIDENCE,
        looks=len(Layout(plan_of(record)).looks()),
        compared_with=(baseline.digest,) if baseline and baseline.batch == record.id else (),
        job_arn=arn("simulation-job", store_id_of(record.arn), ""),
        store_option=store_option(store.url),
    )
    return count_groups(record.arn, results, failures, rules)


def store_option(url: str) -> str:
    """Returns what a command needs to find a store: nothing for ``.simyard`` in the working directory."""
    return "" if url == Path(".simyard").resolve().as_uri() else f"--store {quote(url)}"


def _failure(failure: Exception) -> RunFailure:
    if isinstance(failure, DocumentError):
        reason = f"{failure.source} has faults"
        return RunFailure(code=type(failure).__name__, reason=reason, faults=failure.faults)
    if isinstance(failure, StageFailed):
        kind = _job_kind(failure.arn)
        return RunFailure(
            stage=_section(kind) if kind else None, code=failure.code, reason=failure.reason, arn=failure.arn
        )
    if isinstance(failure, SimyardError):
        return RunFailure(code=type(failure).__name__, reason=str(failure))
    return RunFailure(code=type(failure).__name__, reason=f"this is a defect of Simyard: {failure}")


def _with_stages(asked: AskedRun, found: FullReport, failed: str) -> FullReport:
    """Returns the report with the stages of the run that ended before one failed, as their records say."""
    store = open_existing_store(asked.store_url)
    run_id = _run_id(store, failed)
    if not run_id:
        return found
    run = read(store, "pipeline-run", run_id)
    stages = tuple(_ended_stages(store, run))
    return _with_batch(asked, found.model_copy(update={"run": run.id, "stages": stages}))


def _run_id(store: Store, failed: str) -> str:
    kind, name = _job_kind(failed), resource_name(failed)
    if kind == "pipeline-run":
        return name
    return run_of(read(store, kind, name).token) if kind else ""


def _job_kind(text: str) -> JobKind | None:
    """Returns the kind of the job that an ARN names; None if it names something else, or nothing."""
    found = resource_kind(text) if text else None
    return next((kind for kind in get_args(JobKind) if kind == found), None)


def _section(kind: JobKind) -> StageName | None:
    """Returns the section of a document that asks for such jobs; None for the run itself."""
    return cast("StageName", JOB_KINDS[kind].section) if JOB_KINDS[kind].section else None


def _ended_stages(store: Store, run: JobRecord) -> Iterator[StageReport]:
    """Yields the report of each stage all of whose jobs have ended, or one of them without success."""
    begun: dict[StageName, list[JobRecord | None]] = {}
    for kind, job in jobs_of(run):
        if section := _section(kind):
            begun.setdefault(section, []).append(_ended_job(store, kind, job))
    for section, jobs in begun.items():
        ended = [job for job in jobs if job]
        unlike = [job for job in ended if job.status not in _GOOD]
        if unlike:  # the first that failed is what became of the stage
            yield _stage(store, unlike[0], section)
        elif len(ended) == len(jobs):
            yield _stage(store, joined(ended), section)


def _ended_job(store: Store, kind: JobKind, job: str) -> JobRecord | None:
    try:
        record = read(store, kind, job)
    except ResourceNotFound:
        return None
    return record if is_terminal(record) else None


def _stage(store: Store, record: JobRecord, section: StageName) -> StageReport:
    seconds = record.updated_at_s - record.created_at_s
    if record.status not in _GOOD:
        summary = ": ".join(filter(None, [record.failure_code, record.failure_reason]))
        return StageReport(name=section, arn=record.arn, status=record.status, summary=summary, seconds=seconds)
    if record.kind == "world-generation-job":
        return generation_report(record, store, seconds)
    reports = {"world-export-job": export_report, "simulation-job-batch": batch_report}
    return reports.get(record.kind, deployment_report)(record, seconds)


def _with_batch(asked: AskedRun, found: FullReport) -> FullReport:
    """Returns the report with its batch and its gate, if it came so far."""
    batches = [stage.arn for stage in found.stages if stage.name == "simulationBatch" and stage.arn]
    return _tried(found, lambda: _counted(asked, found, batches[0])) if batches else found


def _counted(asked: AskedRun, found: FullReport, batch: str) -> FullReport:
    store = open_existing_store(asked.store_url)
    record = read(store, KIND, resource_name(batch))
    said = _evidence(store, record.id) if found.verdict else None
    gate = GateReport(verdict=said.verdict, sentence=said.sentence, rules=said.rules) if said else None
    judged = (said.rule, said.verdict, said.baseline) if said else (None, None, None)
    counts = batch_counts(store, record, *judged) if "results_url" in record.detail else None
    return found.model_copy(update={"gate": gate, "batch": counts})


def _evidence(store: Store, batch: str) -> Evidence | None:
    try:
        return read_evidence(store, batch)
    except ObjectNotFound:
        return None


def _tried(found: FullReport, more: Callable[[], FullReport]) -> FullReport:
    """Returns a report with more in it, or with why that could not be found out: a report changes no answer."""
    try:
        return more()
    except (SimyardError, ValidationError) as exc:
        why = " ".join(str(exc).split())
        return found.model_copy(update={"problems": (*found.problems, f"not all could be read: {why}")})


_INDEX = "index"


def next_steps(report: PipelineReport, store: Store) -> list[str]:
    """Returns a line for each command that tells more about a run that did not pass, or about an episode that did not.

    Args:
        report: Of the run.
        store: Where it is recorded.

    Raises:
        StoreError: The store fails.
    """
    steps = [*_of_batch(report, store)] if report.passed or report.verdict not in (None, "PASS") else []
    if report.shipped is False:
        steps += _of_deployment(report, store)
    option = store_option(store.url)
    more = [f"{'more episodes':<22} {line}" for line in _more_episodes(report, store)]
    return [*more, *(f"{what:<22} {' '.join(filter(None, [command, option]))}" for what, command in steps)]


def _more_episodes(report: PipelineReport, store: Store) -> Iterator[str]:
    """Yields how many episodes would decide a success rate that is not decided yet."""
    stage = _stage_named(report, "simulationBatch")
    if stage is None or report.verdict != "INCONCLUSIVE":
        return
    try:
        evidence = read_evidence(store, resource_name(stage.arn))
    except ObjectNotFound:  # the gate had nothing to judge
        return
    yield from _needed(evidence)


def _needed(evidence: Evidence) -> Iterator[str]:
    asked = evidence.rule.successRate
    answer = next((each for each in evidence.rules if each.rule == "successRate"), None)
    if asked is None or answer is None or answer.verdict != "INCONCLUSIVE" or answer.estimate is None:
        return
    needs = share_needs(asked.atLeast, asked.confidence, answer.estimate, answer.counted)
    if needs is None:
        yield f"would not help at this rate: {100 * answer.estimate:.1f} % is not above {100 * asked.atLeast:g} %"
    elif needs.for_80 > answer.counted:
        more = f"{needs.for_80} PASS at this rate with 80 % power, {needs.for_90} with 90 %"
        yield f"{more}, and there are {answer.counted}: set more worlds or seeds"


def _of_batch(report: PipelineReport, store: Store) -> Iterator[tuple[str, str]]:
    stage = _stage_named(report, "simulationBatch")
    if stage is None or not stage.arn:
        return
    if not report.passed:
        yield "look at the report", f"simyard report {stage.arn} --open"
    record = read(store, KIND, resource_name(stage.arn))
    try:
        failed = stored_rows(store, recorded_location(record), record.id, FAILURES_FILE, columns=[_INDEX])
    except ResourceNotFound:  # somebody cleared the tables away
        return
    if failed.num_rows:
        job = f"{record.id}/{failed.column(_INDEX)[0].as_py()}"
        yield "the first that failed", f"simyard replay {arn('simulation-job', store_id(store), job)}"


def _of_deployment(report: PipelineReport, store: Store) -> Iterator[tuple[str, str]]:
    stage = _stage_named(report, "deployment")
    if stage is None or not stage.arn:
        return
    record = read(store, "deployment-job", resource_name(stage.arn))
    yield "robot by robot", f"simyard fleet watch {fleet_name(str(record.request['fleet']))}"


def _stage_named(report: PipelineReport, name: StageName) -> StageReport | None:
    return next((stage for stage in report.stages if stage.name == name), None)
