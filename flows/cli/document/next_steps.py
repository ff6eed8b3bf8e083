"""What a person may do next after a run that did not pass: the commands that show why."""

from collections.abc import Iterator

from flows.ci.run_report import store_option
from specs.arn import arn, resource_name
from specs.data.run_report import PipelineReport, StageName, StageReport
from specs.errors import ObjectNotFound, ResourceNotFound
from tasks.deploy.fleet.fleets import fleet_name
from tasks.results.gate.evidence import Evidence, read_evidence
from tasks.results.statistics.power.shares import share_needs
from tasks.results.tables.result_files import FAILURES_FILE
from tasks.results.tables.stored_rows import stored_rows
from tasks.simulate.batch.job import KIND
from tasks.simulate.plan.request import recorded_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.store_url import store_id

_INDEX = "index"


def next_steps(report: PipelineReport, store: Store) -> list[str]:
    """Returns a line for each command that tells more about a run that did not pass; none for one that passed.

    Args:
        report: Of the run.
        store: Where it is recorded.

    Raises:
        StoreError: The store fails.
    """
    if report.passed:
        return []
    steps = [*_of_batch(report, store)] if report.verdict not in (None, "PASS") else []
    if report.shipped is False:
        steps += _of_deployment(report, store)
    option = store_option(store.url)
    more = [f"{'more episodes':<22} {line}" for line in _more_episodes(report, store)]
    return [*more, *(f"{what:<22} {' '.join(filter(None, [command, option]))}" for what, command in steps)]


def _more_episodes(report: PipelineReport, store: Store) -> Iterator[str]:
    """Yields how many episodes would decide a success rate that is not decided yet."""
    stage = _stage(report, "simulationBatch")
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
    stage = _stage(report, "simulationBatch")
    if stage is None:
        return
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
    stage = _stage(report, "deployment")
    if stage is None or not stage.arn:
        return
    record = read(store, "deployment-job", resource_name(stage.arn))
    yield "robot by robot", f"simyard fleet watch {fleet_name(str(record.request['fleet']))}"


def _stage(report: PipelineReport, name: StageName) -> StageReport | None:
    return next((stage for stage in report.stages if stage.name == name), None)
