"""A run that did not pass ends with the commands that show why."""

from pathlib import Path

import pytest

from flows.cli import ci_report as next_steps_module
from flows.cli.ci_report import next_steps
from specs.data.run_report import PipelineReport, StageReport
from specs.pipeline.gate_section import Gate
from tasks.results.gate.evidence import Evidence
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, submit
from tests.factories.judged_batches import courier, delivery, ended
from tests.factories.planned_batches import mixed


def _stage(name: str, record: JobRecord) -> StageReport:
    return StageReport.model_validate({"name": name, "arn": record.arn, "status": "", "summary": "", "seconds": 0})


def _report(*stages: StageReport, **answer: object) -> PipelineReport:
    return PipelineReport.model_validate({"run": "run-1", "name": "nightly", "stages": stages, **answer})


def test_after_a_fail_the_report_and_the_first_failed_episode_are_named(file_store: Store, tmp_path: Path):
    robot, scenario = courier(file_store, tmp_path, "one"), delivery(file_store, tmp_path)
    batch = ended(file_store, robot, scenario=scenario, simulate=mixed)
    first, second = next_steps(_report(_stage("simulationBatch", batch), verdict="FAIL"), file_store)
    assert f"simyard report {batch.arn} --open --store {file_store.url}" in first
    assert f"simyard replay {batch.arn.replace('-batch:', ':')}/1 --store" in second


@pytest.mark.parametrize(
    ("passed", "told"),
    [
        (
            8,
            "more episodes          35 PASS at this rate with 80 % power, 35 with 90 %, and there are 8: "
            "set more worlds or seeds",
        ),
        (7, "more episodes          would not help at this rate: 87.5 % is not above 90 %"),
    ],
)
def test_after_inconclusive_it_is_told_how_many_episodes_would_do(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, passed: int, told: str
):
    batch = ended(file_store, courier(file_store, tmp_path, "one"), scenario=delivery(file_store, tmp_path))
    rule = Gate.model_validate({"successRate": {"atLeast": 0.9, "confidence": 0.95}})
    answer = RuleVerdict.model_construct(rule="successRate", verdict="INCONCLUSIVE", counted=8, estimate=passed / 8)
    evidence = Evidence.model_construct(rule=rule, rules=(answer,))
    monkeypatch.setattr(next_steps_module, "read_evidence", lambda *_: evidence)
    report = _report(_stage("simulationBatch", batch), verdict="INCONCLUSIVE")
    assert next_steps(report, file_store)[0] == told


def test_a_run_that_passed_needs_no_next_step(file_store: Store):
    assert next_steps(_report(verdict="PASS"), file_store) == []


def test_after_a_failed_roll_out_the_fleet_can_be_watched(file_store: Store):
    job = submit(file_store, "deployment-job", {"fleet": "tuggers"}, "token")
    report = _report(_stage("deployment", job), verdict="PASS", shipped=False)
    assert next_steps(report, file_store) == [
        f"{'robot by robot':<22} simyard fleet watch tuggers --store {file_store.url}"
    ]
