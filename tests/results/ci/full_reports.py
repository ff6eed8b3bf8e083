"""Whole reports of runs, without a run: tables as a batch writes them, counted."""

from collections.abc import Sequence

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.run_report import Artefact, StageReport, Verdict
from tasks.results.ci.full_report import CountedBatch, FullReport, GateReport, RunFailure
from tasks.results.ci.seed_groups import GroupRules, count_groups
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.tables.episode_tables import failures_table, results_table
from tests.factories.reports import episodes

HOSTILE = (
    "a|b\\|c`</td><script>\x00\x1b]0;x\x07 @everyone #7 [x](https://evil.example)"
    "\n::set-output name=a::b\r\n##[add-mask]e %0A"
)
"""What a stranger may write into a name, a reason or a sentence."""
JOB_ARN = "arn:simyard:simulation-job:0123456789ab:"
RULES = GroupRules(job_arn=JOB_ARN)


def counted(
    requests: Sequence[EpisodeRequest] | None = None,
    results: Sequence[EpisodeResult] | None = None,
    rules: GroupRules = RULES,
) -> CountedBatch:
    """Returns a batch in groups; of two worlds and two speeds, if no episodes are given."""
    asked, answered = episodes() if requests is None or results is None else (requests, results)
    results_rows, failures_rows = (table("simb-1", asked, answered, []) for table in (results_table, failures_table))
    return count_groups("arn:simyard:simulation-job-batch:0123456789ab:simb-1", results_rows, failures_rows, rules)


def rule(verdict: Verdict, name: str = "successRate", sentence: str = "") -> RuleVerdict:
    """Returns a rule's answer."""
    said = sentence or f"{verdict}: 5 of 10 episodes passed"
    return RuleVerdict(
        rule=name, verdict=verdict, sentence=said, method="Wilson", counted=10, estimate=0.5, lower=0.2, upper=0.8
    )


def stage(**changes: object) -> StageReport:
    """Returns the report of a stage."""
    base = StageReport(
        name="simulationBatch",
        arn="arn:simyard:simulation-job-batch:0123456789ab:simb-1",
        status="Completed",
        summary="5 of 10 episodes passed",
        seconds=2.5,
        artefacts=(Artefact(label="report", url="file:///tmp/report.html"),),
    )
    return base.model_copy(update=changes)


def full_report(**changes: object) -> FullReport:
    """Returns the report of a run that did not pass."""
    base = FullReport(
        answer="NOT PASSED",
        exit_code=1,
        document="nightly",
        store="file:///tmp/store",
        run="run-1",
        verdict="FAIL",
        stages=(stage(),),
        gate=GateReport(
            verdict="FAIL", sentence="FAIL: of 2 rules", rules=(rule("FAIL"), rule("INCONCLUSIVE", "collisionRate"))
        ),
        batch=counted(),
    )
    return base.model_copy(update=changes)


def failed_report(reason: str = "nobody answers") -> FullReport:
    """Returns the report of a run whose export failed."""
    failure = RunFailure(stage="worldExport", code="InternalServiceError", reason=reason, arn="arn:simyard:x")
    before = stage(name="worldGeneration", summary="2 worlds")
    return full_report(
        answer="FAILED", exit_code=3, verdict=None, gate=None, batch=None, stages=(before,), failure=failure
    )
