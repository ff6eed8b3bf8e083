"""A run that did not pass ends with the commands that show why."""

from pathlib import Path

from flows.cli.document.next_steps import next_steps
from specs.data.run_report import PipelineReport, StageReport
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


def test_a_run_that_passed_needs_no_next_step(file_store: Store):
    assert next_steps(_report(verdict="PASS"), file_store) == []


def test_after_a_failed_roll_out_the_fleet_can_be_watched(file_store: Store):
    job = submit(file_store, "deployment-job", {"fleet": "tuggers"}, "token")
    report = _report(_stage("deployment", job), verdict="PASS", shipped=False)
    assert next_steps(report, file_store) == [
        f"{'robot by robot':<22} simyard fleet watch tuggers --store {file_store.url}"
    ]
