"""A batch that has ended is judged by another gate: as its run would have, and with evidence that ships nothing."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import pytest
import typer
from junitparser import JUnitXml
from pydantic import ValidationError
from typer.testing import CliRunner

from flows.cli.batch_commands import gate as gate_command
from flows.pipeline.judge_again import judge_again
from flows.pipeline.run_gate import gate_answer
from specs.data.episode import EpisodeResult
from specs.errors import DocumentError, ResourceNotFound
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from tasks.results.gate.evidence import Evidence
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.factories.episodes import passed
from tests.factories.judged_batches import courier, delivery, document, ended, run_of
from tests.factories.planned_batches import all_pass, begun, mixed
from tests.flows.batch.test_batch_steps import GATE as EARLY
from tests.flows.batch.test_batch_steps import closed, driven, every_other_collides, started

LENIENT = {"successRate": {"atLeast": 0.5}}
STRICT = {"successRate": {"atLeast": 0.99}}


def batch_of(store: Store, folder: Path, simulate: Simulate = all_pass, name: str = "tok") -> JobRecord:
    return ended(store, courier(store, folder, "one"), scenario=delivery(store, folder), simulate=simulate, name=name)


def waits(part: ChunkPart) -> list[EpisodeResult]:
    return [passed(each.index).model_copy(update={"metrics": {"waiting_s": 2.0}}) for each in part.chunk.requests]


def quantile(column: str) -> PipelineSpec:
    return document({"quantiles": [{"column": column, "quantile": 0.5, "atMost": 30}]})


def results_key(record: JobRecord, store: Store) -> str:
    return str(record.detail["results_url"]).removeprefix(f"{store.url}/")


def test_a_stricter_gate_fails_what_the_run_passed_and_leaves_its_evidence_alone(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path)
    gate_answer(Gate.model_validate(LENIENT), batch, file_store, run_of(file_store))
    before = file_store.get(result_key(batch.id, "evidence.json")).body
    found = judge_again(file_store, batch.id, document(STRICT))
    assert (found.run_verdict, found.verdict) == ("PASS", "INCONCLUSIVE")
    assert file_store.get(result_key(batch.id, "evidence.json")).body == before


def test_the_same_gate_says_what_the_run_said(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path)
    answer = gate_answer(Gate.model_validate(LENIENT), batch, file_store, run_of(file_store))
    assert judge_again(file_store, batch.arn, document(LENIENT)).sentence == answer.sentence


def test_each_document_has_evidence_of_its_own_that_names_it(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path)
    first, again, other = (judge_again(file_store, batch.id, document(each)) for each in (LENIENT, LENIENT, STRICT))
    assert first.evidence == again.evidence != other.evidence
    body = file_store.get(other.evidence.url.removeprefix(f"{file_store.url}/")).body
    assert hashlib.sha256(body).hexdigest() == other.evidence.sha256
    assert f'"document":"{other.document}"'.encode() in body
    assert b'"kind":"later judgement"' in body


def test_its_evidence_is_no_evidence_for_a_deployment(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path)
    found = judge_again(file_store, batch.id, document(LENIENT))
    body = file_store.get(found.evidence.url.removeprefix(f"{file_store.url}/")).body
    assert found.verdict == "PASS"
    with pytest.raises(ValidationError):
        Evidence.model_validate_json(body)


def test_a_run_that_goes_on_does_not_take_a_later_answer_for_its_own(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path, mixed)
    assert judge_again(file_store, batch.id, document({"successRate": {"atLeast": 0.3}})).verdict == "PASS"
    assert gate_answer(Gate.model_validate(STRICT), batch, file_store, run_of(file_store)).verdict == "FAIL"


def test_a_batch_that_ended_early_is_judged_by_what_holds_at_all_looks_whatever_the_gate_says(file_store: Store):
    batch = started(file_store)
    record = closed(batch, driven(batch))
    found = judge_again(file_store, record.id, document({"successRate": {"atLeast": 0.9}}))
    assert (found.verdict, found.rules[0].method) == ("PASS", "repeated confidence interval")
    assert "96 not needed any more" in found.sentence


def test_a_batch_that_might_have_ended_early_is_judged_so_too(file_store: Store):
    batch = started(file_store, EARLY)
    driven(batch, every_other_collides, Gate.model_validate({"successRate": {"atLeast": 0.5}, "stopEarly": True}))
    found = judge_again(file_store, closed(batch, {}).id, document(LENIENT))
    assert found.rules[0].method == "repeated confidence interval"


def test_another_version_is_found_as_in_a_run(file_store: Store, tmp_path: Path):
    old, new = (courier(file_store, tmp_path, text) for text in ("old", "new"))
    scenario = delivery(file_store, tmp_path)
    ended(file_store, old, scenario=scenario, name="before")
    batch = ended(file_store, new, scenario=scenario, name="now")
    rule = document({"noWorseThan": {"applicationVersion": "1", "margin": 0.06}})
    assert judge_again(file_store, batch.id, rule).verdict == "PASS"


def test_versions_that_a_gate_would_count_together_are_refused(file_store: Store, tmp_path: Path):
    robots = [courier(file_store, tmp_path, text) for text in ("old", "new")]
    batch = ended(file_store, *robots, scenario=delivery(file_store, tmp_path))
    with pytest.raises(DocumentError, match="gate: courier version 1, courier version 2: a batch that tests one"):
        judge_again(file_store, batch.id, document(LENIENT))


def test_a_version_that_there_is_not_is_a_fault_of_the_rule(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path)
    with pytest.raises(ResourceNotFound) as caught:
        judge_again(file_store, batch.id, document({"noWorseThan": {"applicationVersion": "7", "margin": 0.06}}))
    assert caught.value.faults[0].path == "gate.noWorseThan.applicationVersion"


def test_a_metric_that_no_episode_has_is_refused_with_the_one_that_was_meant(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path, waits)
    assert judge_again(file_store, batch.id, quantile("metrics.waiting_s")).verdict == "PASS"
    with pytest.raises(DocumentError) as caught:
        judge_again(file_store, batch.id, quantile("metrics.wating_s"))
    (fault,) = caught.value.faults
    assert (fault.path, fault.value) == ("gate.quantiles[0].column", '"metrics.wating_s"')
    assert fault.allowed.startswith('did you mean "metrics.waiting_s"?')


def test_a_metric_of_a_scenario_that_measures_nothing_is_refused(file_store: Store, tmp_path: Path):
    with pytest.raises(DocumentError, match="measures nothing by itself"):
        judge_again(file_store, batch_of(file_store, tmp_path).id, quantile("metrics.waiting_s"))


def test_a_document_without_a_gate_is_refused(file_store: Store, tmp_path: Path):
    spec = document(LENIENT).model_copy(update={"gate": None})
    with pytest.raises(DocumentError, match="gate: missing"):
        judge_again(file_store, batch_of(file_store, tmp_path).id, spec)


def test_a_batch_that_has_not_ended_is_refused(file_store: Store):
    with pytest.raises(DocumentError, match="its tables come when it ends"):
        judge_again(file_store, begun(file_store).id, document(LENIENT))


@pytest.mark.parametrize("name", ["results.parquet", "failures.parquet"])
def test_tables_that_are_not_what_the_batch_wrote_are_refused_by_name(file_store: Store, tmp_path: Path, name: str):
    batch = batch_of(file_store, tmp_path)
    key = results_key(batch, file_store).replace("results.parquet", name)
    body = file_store.get(key).body
    file_store.put(key, body[:-1] + b"\0")
    with pytest.raises(DocumentError, match=f"{name}: SHA-256 .*run its document again"):
        judge_again(file_store, batch.id, document(LENIENT))
    file_store.delete(key)
    with pytest.raises(DocumentError, match=f"{name}: gone: .*run its document again"):
        judge_again(file_store, batch.id, document(LENIENT))


@pytest.mark.parametrize(("gate", "code"), [(LENIENT, 0), ({"successRate": {"atLeast": 0.9999}}, 4), ({}, 2)])
def test_the_exit_code_is_the_verdict(
    file_store: Store, tmp_path: Path, gate: Mapping[str, object], code: int, monkeypatch: pytest.MonkeyPatch
):
    batch = batch_of(file_store, tmp_path)
    path = tmp_path / "gate.yaml"
    path.write_text(
        document(gate or LENIENT).model_dump_json(exclude_none=True, exclude={"gate"} if not gate else None)
    )
    app = typer.Typer()
    app.command()(gate_command)
    found = CliRunner().invoke(app, [batch.id, "--document", str(path), "--store", file_store.url])
    assert (2 if isinstance(found.exception, DocumentError) else found.exit_code) == code


def test_a_failed_gate_exits_with_1_and_prints_the_verdict_first(file_store: Store, tmp_path: Path):
    batch = batch_of(file_store, tmp_path, mixed)
    path = tmp_path / "gate.yaml"
    path.write_text(document(STRICT).model_dump_json(exclude_none=True))
    app = typer.Typer()
    app.command()(gate_command)
    found = CliRunner().invoke(app, [batch.id, "--document", str(path), "--store", file_store.url])
    assert found.exit_code == 1
    assert found.stdout.startswith("FAIL: ")
    assert "ships nothing" in found.stdout


def test_a_batch_that_cannot_be_judged_leaves_no_older_file(file_store: Store, tmp_path: Path):
    path, junit = tmp_path / "gate.yaml", tmp_path / "junit.xml"
    path.write_text(document(STRICT).model_dump_json(exclude_none=True))
    junit.write_text("of yesterday")
    app = typer.Typer()
    app.command()(gate_command)
    asked = ["simb-0000000000000000", "--document", str(path), "--junit", str(junit), "--store", file_store.url]
    assert isinstance(CliRunner().invoke(app, asked).exception, ResourceNotFound)
    assert "simb-0000000000000000" in junit.read_text()
    assert JUnitXml.fromfile(str(junit)).errors == 1


def test_a_file_that_cannot_be_written_is_refused_before_a_batch_is_judged(file_store: Store, tmp_path: Path):
    path = tmp_path / "gate.yaml"
    path.write_text(document(STRICT).model_dump_json(exclude_none=True))
    app = typer.Typer()
    app.command()(gate_command)
    asked = [batch_of(file_store, tmp_path).id, "--document", str(path), "--store", file_store.url]
    found = CliRunner().invoke(app, [*asked, "--junit", str(tmp_path)])
    assert isinstance(found.exception, DocumentError)
    assert found.stdout == ""
