"""The whole report of a run, from real records: what passed, what failed, and what cannot be read any more."""

from pathlib import Path

import pytest
from junitparser import JUnitXml
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.cli import ci_report as next_steps_module
from flows.cli.ci_report import batch_counts, next_steps, report_of_failure, report_of_run, store_option
from flows.cli.run_command import AskedRun
from flows.cli.shell import app
from flows.pipeline.run_gate import gate_answer
from flows.pipeline.stage_report import batch_report, gate_report
from specs.base import Fault
from specs.data.episode import EpisodeResult
from specs.data.run_report import PipelineReport, StageReport
from specs.errors import DocumentError, PipelineNotPassed, StageFailed
from specs.job_kinds import JobKind
from specs.pipeline.gate_section import Gate
from tasks.results.gate.evidence import Evidence, read_evidence
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.simulate.batch.chunk_run import ChunkPart
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery, document, ended, run_of
from tests.factories.planned_batches import mixed

GATE = Gate.model_validate({"successRate": {"atLeast": 0.9}})


def _half(part: ChunkPart) -> list[EpisodeResult]:
    """Fails every second seed of the world w1."""
    return [
        (collided if each.world == "g/w1" and each.seed % 2 else passed)(each.index) for each in part.chunk.requests
    ]


def _judged(store: Store, folder: Path) -> tuple[JobRecord, PipelineReport]:
    batch = ended(store, courier(store, folder, "one"), scenario=delivery(store, folder), simulate=_half)
    answer = gate_answer(GATE, batch, store, run := run_of(store))
    stages = (batch_report(batch, 1.0), gate_report(answer.verdict, answer.sentence, answer.evidence_url, 0.1))
    return batch, PipelineReport(run=run.id, name="nightly", stages=stages, verdict=answer.verdict)


def test_a_run_that_failed_is_reported_with_its_rules_its_worlds_and_commands(file_store: Store, tmp_path: Path):
    batch, report = _judged(file_store, tmp_path)
    found = report_of_failure(AskedRun("nightly", file_store.url), PipelineNotPassed(report), 1)
    assert (found.answer, found.exit_code, found.verdict, found.problems) == ("NOT PASSED", 1, "FAIL", ())
    assert found.gate
    assert [(rule.rule, rule.verdict) for rule in found.gate.rules] == [("successRate", "FAIL")]
    assert found.batch
    assert [(world.label, world.passed, world.episodes) for world in found.batch.worlds] == [
        ("w0", 40, 40),
        ("w1", 20, 40),
    ]
    (group,) = found.batch.worlds[1].groups
    assert (group.state, found.batch.bar) == ("failed", 0.9)
    job = group.examples[0].job
    assert job.startswith("arn:simyard:simulation-job:")
    assert job.rpartition("/")[0].endswith(batch.id)
    assert group.examples[0].replay == f"simyard replay {job} --store {file_store.url}"


def test_the_version_that_is_only_compared_with_is_not_failed(file_store: Store, tmp_path: Path):
    older, newer = (courier(file_store, tmp_path, text) for text in ("one", "two"))
    batch = ended(file_store, older, newer, scenario=delivery(file_store, tmp_path), simulate=_half)
    gate = Gate.model_validate({"noWorseThan": {"applicationVersion": older.version, "margin": 0.2}})
    gate_answer(gate, batch, file_store, run_of(file_store))
    evidence = read_evidence(file_store, batch.id)
    counts = batch_counts(file_store, batch, evidence.rule, evidence.verdict, evidence.baseline)
    notes = {
        group.name: group.note for world in counts.worlds for group in world.groups if group.passed < group.episodes
    }
    assert [note for name, note in notes.items() if "robot_version=1" in name] == ["this version is only compared with"]


def test_results_that_are_gone_are_a_problem_and_not_another_answer(file_store: Store, tmp_path: Path):
    batch, report = _judged(file_store, tmp_path)
    key = str(batch.detail["results_url"]).removeprefix(f"{file_store.url}/")
    file_store.put(key, b"something else")
    found = report_of_run(AskedRun("nightly", file_store.url), report, 1)
    assert (found.answer, found.batch) == ("NOT PASSED", None)
    assert "is not what the batch wrote" in found.problems[0]


def test_a_document_that_is_refused_is_reported_with_its_faults():
    fault = Fault(path="gate.successRate", value="2", allowed="0 to 1")
    found = report_of_failure(AskedRun("nightly", "file:///x"), DocumentError([fault], "nightly.yaml"), 2)
    assert found.answer == "REFUSED"
    assert found.failure
    assert (found.failure.code, found.failure.faults) == ("DocumentError", (fault,))


@pytest.mark.parametrize(
    ("arn", "stage"),
    [
        ("arn:simyard:simulation-job-batch:0:simb-1", "simulationBatch"),
        ("arn:simyard:pipeline-run:0:run-1", None),
        ("", None),
    ],
)
def test_a_stage_that_failed_is_named_even_if_its_record_is_gone(arn: str, stage: str | None, tmp_path: Path):
    failure = StageFailed("InternalServiceError", "no answer", arn)
    found = report_of_failure(AskedRun("nightly", (tmp_path / "none").as_uri()), failure, 3)
    assert (found.answer, found.exit_code) == ("FAILED", 3)
    assert found.failure
    assert (found.failure.stage, found.failure.reason) == (stage, "no answer")


def test_a_defect_is_reported_as_one():
    found = report_of_failure(AskedRun("nightly", "file:///x"), RuntimeError("oh"), 3)
    assert found.failure
    assert (found.failure.code, found.failure.reason) == ("RuntimeError", "this is a defect of Simyard: oh")


def test_commands_name_the_store_unless_it_is_the_one_they_would_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert store_option((tmp_path / ".simyard").as_uri()) == ""
    assert store_option("s3://bucket/a b") == "--store 's3://bucket/a b'"


def test_stages_before_one_that_failed_are_reported_from_their_records(file_store: Store):
    sections: dict[str, JsonValue] = {"name": "nightly", "worldGeneration": {}, "simulationBatch": {}}
    run = submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": sections}, "run")
    worlds = submit(file_store, "world-generation-job", {}, stage_token(run, "worlds"))
    advance(file_store, "world-generation-job", worlds.id, "Completed", detail={"worlds": ["g/a", "g/b"]})
    batch = submit(file_store, "simulation-job-batch", {}, stage_token(run, "batch"))
    advance(file_store, "simulation-job-batch", batch.id, "TimedOut", failure_reason="the 1 s were over")
    failure = StageFailed("TimedOut", "the 1 s were over", batch.arn)
    found = report_of_failure(AskedRun("nightly", file_store.url), failure, 3)
    assert (found.run, found.problems) == (run.id, ())
    assert [(stage.name, stage.status, stage.summary) for stage in found.stages] == [
        ("worldGeneration", "Completed", "2 worlds"),
        ("simulationBatch", "TimedOut", "the 1 s were over"),
    ]


def test_a_batch_that_is_judged_again_gets_a_file_like_that_of_its_run(file_store: Store, tmp_path: Path):
    batch, _ = _judged(file_store, tmp_path)
    spec = document({"successRate": {"atLeast": 0.3}})
    (tmp_path / "again.json").write_text(spec.model_dump_json(exclude_none=True))
    words = ["gate", batch.id, "--document", str(tmp_path / "again.json"), "--store", file_store.url]
    done = CliRunner().invoke(app, [*words, "--junit", str(tmp_path / "junit.xml")])
    assert done.exit_code == 0, done.output
    suites = {str(suite.name): suite for suite in JUnitXml.fromfile(str(tmp_path / "junit.xml"))}
    assert list(suites) == ["run", "gate", "w0", "w1"]
    assert [(suite.failures, suite.tests) for suite in suites.values()] == [(0, 1), (0, 1), (0, 1), (0, 1)]


def test_a_stage_has_not_ended_while_one_of_its_jobs_has_not(file_store: Store):
    spec: dict[str, JsonValue] = {"worldGeneration": {"worldCount": {"floorplanCount": 100}}}
    run = submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": spec}, "run")
    first, second = (submit(file_store, kind, {}, token) for kind, token in _generations(run))
    detail: dict[str, JsonValue] = {"worlds": [], "failures": {}}
    advance(file_store, first.kind, first.id, "Completed", detail=detail)
    failure = StageFailed("InternalServiceError", "the process died", run.arn)
    assert report_of_failure(AskedRun("nightly", file_store.url), failure, 3).stages == ()
    advance(file_store, second.kind, second.id, "Completed", detail=detail)
    (stage,) = report_of_failure(AskedRun("nightly", file_store.url), failure, 3).stages
    assert (stage.name, stage.status) == ("worldGeneration", "Completed")


def _generations(run: JobRecord) -> list[tuple[JobKind, str]]:
    token = stage_token(run, "worlds")
    return [("world-generation-job", token), ("world-generation-job", f"{token}-2")]


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


def test_after_a_pass_the_first_failed_episode_alone_is_named(file_store: Store, tmp_path: Path):
    robot, scenario = courier(file_store, tmp_path, "one"), delivery(file_store, tmp_path)
    batch = ended(file_store, robot, scenario=scenario, simulate=mixed)
    (line,) = next_steps(_report(_stage("simulationBatch", batch), verdict="PASS"), file_store)
    assert line.startswith(f"the first that failed  simyard replay {batch.arn.replace('-batch:', ':')}/1 --store")


def test_a_run_in_which_all_passed_needs_no_next_step(file_store: Store, tmp_path: Path):
    batch = ended(file_store, courier(file_store, tmp_path, "one"), scenario=delivery(file_store, tmp_path))
    assert next_steps(_report(_stage("simulationBatch", batch), verdict="PASS"), file_store) == []


def test_after_a_failed_roll_out_the_fleet_can_be_watched(file_store: Store):
    job = submit(file_store, "deployment-job", {"fleet": "tuggers"}, "token")
    report = _report(_stage("deployment", job), verdict="PASS", shipped=False)
    assert next_steps(report, file_store) == [
        f"{'robot by robot':<22} simyard fleet watch tuggers --store {file_store.url}"
    ]
