"""A list of runs and batches tells a FAIL from an INCONCLUSIVE, and whose batch it is."""

import json

import pytest
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.cli.shell import app
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.planned_batches import begun

WHY = "31 of 40 episodes passed, and 36 are needed; " + 60 * "more "


def _judged(store: Store, verdict: str) -> str:
    """Returns the ARN of a batch that a run's gate has judged."""
    spec: dict[str, JsonValue] = {"name": "nightly", "simulationBatch": {}, "gate": {}}
    run = submit(store, "pipeline-run", {"flow": "pipeline", "spec": spec}, verdict)
    batch = begun(store, name=stage_token(run, "batch"))
    advance(store, "simulation-job-batch", batch.id, "Completed", detail={"passed": 31, "episodes": 40})
    stage: dict[str, JsonValue] = {"name": "gate", "arn": "", "status": verdict, "summary": WHY, "seconds": 0}
    report: dict[str, JsonValue] = {"run": run.id, "name": "nightly", "stages": [stage], "verdict": verdict}
    status = "Completed" if verdict == "PASS" else "Failed"
    advance(store, "pipeline-run", run.id, status, detail={"report": report})
    return batch.record().arn


def _list(store: Store, *arguments: str) -> str:
    return CliRunner().invoke(app, ["list", *arguments, "--store", store.url], catch_exceptions=False).stdout


@pytest.mark.parametrize("verdict", ["FAIL", "INCONCLUSIVE"])
def test_a_run_that_did_not_pass_says_its_verdict_and_why(file_store: Store, verdict: str):
    _judged(file_store, verdict)
    row = json.loads(_list(file_store, "pipeline-runs", "--json"))
    assert (row["status"], row["verdict"], row["failureReason"]) == ("Failed", verdict, f"{verdict}: {WHY}")


def test_a_run_that_passed_has_no_reason(file_store: Store):
    _judged(file_store, "PASS")
    assert "failureReason" not in json.loads(_list(file_store, "pipeline-runs", "--json"))


def test_a_long_reason_pads_no_row(file_store: Store):
    _judged(file_store, "FAIL")
    assert max(map(len, _list(file_store, "pipeline-runs").splitlines())) < 260


def test_a_batch_is_listed_with_its_document_verdict_and_rate(file_store: Store):
    arn = _judged(file_store, "FAIL")
    _, row = _list(file_store, "simulation-job-batches").splitlines()
    assert row.split()[:4] == [arn, "nightly", "FAIL", "31/40"]


def test_robomakers_answer_about_a_batch_stays_robomakers(file_store: Store):
    _judged(file_store, "FAIL")
    assert "verdict" not in json.loads(_list(file_store, "simulation-job-batches", "--json"))
