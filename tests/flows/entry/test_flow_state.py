"""What a flow run's state says of the work, in one line, and that the work itself is the flow's result."""

from typing import cast

import pytest
from prefect.client.schemas.objects import State
from prefect.states import Cancelled
from pydantic import JsonValue

from flows.prefect.flow_calls import completed_job, completed_reaping, completed_run
from flows.resources.abandoned_jobs import ReapedJob
from specs.data.run_report import PipelineReport, StageName, StageReport
from specs.errors import PipelineNotPassed
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit

BATCH: dict[str, JsonValue] = {"passed": 380, "episodes": 384, "simulated_s": 12.0}


def job(store: Store, kind: JobKind, status: str, detail: dict[str, JsonValue], reason: str = "") -> JobRecord:
    record = submit(store, kind, {}, "tok")
    return advance(store, kind, record.id, status, detail=detail, failure_reason=reason)


def state(result: object) -> State[object]:
    return cast("State[object]", result)


def stage(name: StageName, summary: str, status: str = "Completed") -> StageReport:
    return StageReport(name=name, arn="", status=status, summary=summary, seconds=0.1)


@pytest.mark.parametrize(
    ("kind", "status", "detail", "message"),
    [
        (
            "world-generation-job",
            "PartialFailed",
            {"worlds": ["w/1", "w/2"], "failures": {"ResourceNotFound": {"count": 1}}},
            "PartialFailed: 2 worlds, 1 failed: {arn}",
        ),
        ("world-export-job", "Completed", {"zip": "s3://b/x.zip"}, "1 zip: s3://b/x.zip ({arn})"),
        ("simulation-job-batch", "Completed", BATCH, "380 of 384 episodes passed, 12 simulated seconds: {arn}"),
        ("deployment-job", "Succeeded", {}, "0 of 0 robots in sync: {arn}"),
    ],
)
def test_a_jobs_state_says_what_it_made_and_where(
    file_store: Store, kind: JobKind, status: str, detail: dict[str, JsonValue], message: str
):
    record = job(file_store, kind, status, detail)
    found = state(completed_job(record))

    assert found.is_completed()
    assert found.message == message.format(arn=record.arn)
    assert found.data == record


def test_the_state_of_a_cancelled_flow_run_stays_as_it_is():
    canceled = Cancelled(message="canceled on request")
    assert state(completed_job(cast("JobRecord", canceled))) is canceled
    assert state(completed_run(cast("PipelineReport", canceled))) is canceled


def test_a_runs_state_has_the_verdict_and_the_first_figures_of_each_stage():
    stages = (
        stage("worldGeneration", "8 worlds"),
        stage("simulationBatch", "380 of 384 episodes passed, 12 simulated seconds; audit SOUND"),
        stage("gate", "success rate 0.99", "PASS"),
        stage("deployment", "5 of 5 robots in sync; UNSIGNED", "Succeeded"),
    )
    report = PipelineReport(run="run-1", name="nightly", stages=stages, verdict="PASS", shipped=True)

    assert state(completed_run(report)).message == (
        "PASS, shipped: 8 worlds; 380 of 384 episodes passed, 12 simulated seconds; 5 of 5 robots in sync (run-1)"
    )


def test_a_run_without_a_gate_has_no_verdict_in_its_message():
    report = PipelineReport(run="run-1", name="worlds", stages=(stage("worldGeneration", "2 worlds"),))
    assert state(completed_run(report)).message == "2 worlds (run-1)"


def test_a_failed_gates_message_has_the_rule_and_its_figures():
    stages = (stage("gate", "success rate 0.61 to 0.70, at least 0.9 wanted", "FAIL"),)
    failure = PipelineNotPassed(PipelineReport(run="run-1", name="nightly", stages=stages, verdict="FAIL"))
    assert str(failure) == "nightly: the gate says FAIL: success rate 0.61 to 0.70, at least 0.9 wanted (run-1)"


def test_a_failed_roll_outs_message_has_the_robots():
    stages = (stage("gate", "all well", "PASS"), stage("deployment", "1 of 5 robots in sync", "Failed"))
    report = PipelineReport(run="run-1", name="nightly", stages=stages, verdict="PASS", shipped=False)
    assert str(PipelineNotPassed(report)) == "nightly: the deployment failed: 1 of 5 robots in sync (run-1)"


def test_reaping_counts_what_became_of_the_jobs():
    found = [ReapedJob(arn=str(n), was="Running", status=status, meaning="") for n, status in enumerate("AAB")]
    assert state(completed_reaping(found)).message == "3 abandoned jobs: 2 now A, 1 now B"
    assert state(completed_reaping([])).message == "no abandoned job"
